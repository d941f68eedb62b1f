"""A results folder as data frames and as a dataset for other programs."""

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results
from scipy.stats import chi2

import anchorpose
from anchorpose.joints import JOINT_NAMES

pd = pytest.importorskip("pandas", reason="data frames need the extra 'frames'")
xr = pytest.importorskip("xarray", reason="datasets need the extra 'frames'")

PLACES = standing_joints()


@pytest.fixture
def results(tmp_path):
    frames = [make_frame(k, 0.1 * k, PLACES + 0.01 * k, lost=("HandLeft",) if k == 1 else ()) for k in range(4)]
    return anchorpose.open(write_results(tmp_path / "results", frames))


def test_tables_are_data_frames_with_what_the_files_have(results):
    assert isinstance(results.joints, pd.DataFrame)
    assert results.joints.shape[0] == 4 * len(JOINT_NAMES)
    head = results.joints[results.joints.joint == "Head"]
    np.testing.assert_allclose(head.y_m, [1.62, 1.63, 1.64, 1.65])
    lost = results.joints[results.joints.state == "lost"]
    assert lost.joint.tolist() == ["HandLeft"]
    assert lost[["x_m", "sigma_m"]].isna().all(axis=None)
    assert "knee_flexion_left" in set(results.angles.angle)
    assert results.run["frame_count"] == 4


def test_a_dataset_has_the_dimensions_of_movement(results):
    found = results.to_xarray()
    assert found.position.dims == ("time", "space", "keypoints", "individuals")
    assert found.confidence.dims == ("time", "keypoints", "individuals")
    assert found.attrs["ds_type"] == "poses"
    assert found.attrs["time_unit"] == "seconds"
    assert found.attrs["fps"] == pytest.approx(10.0)
    np.testing.assert_allclose(found.position.sel(keypoints="Head", space="y").squeeze(), [1.62, 1.63, 1.64, 1.65])
    hand = found.sel(keypoints="HandLeft").squeeze()
    np.testing.assert_array_equal(np.isnan(hand.confidence), [False, True, False, False])
    assert np.isnan(hand.position[1]).all()
    assert hand.state.values.tolist() == ["observed", "lost", "observed", "observed"]
    assert float(hand.confidence[0]) == pytest.approx(chi2.cdf(25.0, 3))


def test_a_change_to_a_dataset_does_not_change_the_results(results):
    before = results.to_xarray().copy(deep=True)
    changed = results.to_xarray()
    changed["position"] *= 1000.0
    changed["sigma"] *= 1000.0
    assert results.to_xarray().identical(before)
    np.testing.assert_array_equal(results.joint_table.position_m[:, 0, :], before.position[:, :, 0, 0])


def test_confidence_falls_with_sigma_and_uneven_times_have_no_rate(tmp_path):
    frames = [
        make_frame(k, time_s, PLACES, sigma_m=sigma)
        for k, (time_s, sigma) in enumerate([(0, 0.01), (0.1, 0.1), (0.3, 0.3)])
    ]
    found = anchorpose.open(write_results(tmp_path / "results", frames)).to_xarray()
    confidence = found.confidence.sel(keypoints="Head").squeeze().values
    assert (np.diff(confidence) < 0.0).all()
    assert confidence[0] > 0.999
    assert "fps" not in found.attrs


def test_what_is_no_results_folder_is_refused(tmp_path):
    with pytest.raises(anchorpose.InputError, match="is not a results folder; give a folder"):
        anchorpose.open(tmp_path)
