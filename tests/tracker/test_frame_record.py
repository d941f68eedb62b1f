"""poses, anchors and people: what goes in comes out, a lost frame stays one, and the pose is that of the joints."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from anchorpose.body.pose import MOVING_BONES, POSE_SIZE, Pose, moving_bones
from anchorpose.body.segments import load_body_asset
from anchorpose.body.skin_points import FittedShape, body_points, build_body, even_clothes
from anchorpose.errors import InputError
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.results.records import (
    ROOM,
    LabelImage,
    StoredPeople,
    decode_labels,
    encode_labels,
    read_people,
    write_people,
)
from anchorpose.results.tables import AnchorFrame, pose_of, read_anchors, read_poses, write_anchors, write_poses
from anchorpose.tracker.frame_record import axial_sigma, body_pose

POINTS = body_points()
BODY = build_body(POINTS, FittedShape(np.array([1.0, -0.5, 0.3]), even_clothes(0.008)))


def any_pose(seed: int) -> Pose:
    asset, rng = load_body_asset(), np.random.default_rng(seed)
    rest = Pose(np.tile(np.eye(3), (len(asset.bone_names), 1, 1)), np.zeros(3))
    return rest.moved(rng.normal(scale=0.6, size=POSE_SIZE), moving_bones(asset))


def written(tmp_path, poses):
    with write_poses(tmp_path / "poses.parquet") as table:
        for pose in poses:
            table.append(pose)
    return read_poses(tmp_path / "poses.parquet")


@pytest.mark.parametrize("seed", range(5))
def test_the_joints_can_be_had_from_the_table_again(seed, tmp_path):
    pose = any_pose(seed)
    table = written(tmp_path, [body_pose(BODY, 7, 0.25, pose, None)])
    again = pose_of(POINTS.asset, table.head_m[0], table.quaternion[0])
    joints = [BODY.joints(p) for p in (pose, again)]
    np.testing.assert_allclose(joints[1], joints[0], atol=2e-6)  # float32 at a metre: 0.1 micrometres a number
    assert table.frame.tolist() == [7]
    assert table.time_s.tolist() == [0.25]
    assert np.isnan(table.axial_sigma_rad).all()


def test_the_rest_pose_is_no_turn_at_all():
    pose = Pose(np.tile(np.eye(3), (len(POINTS.asset.bone_names), 1, 1)), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(body_pose(BODY, 0, 0.0, pose, None).quaternion, [[1.0, 0, 0, 0]] * 21, atol=1e-12)


def test_a_lost_frame_has_no_pose(tmp_path):
    table = written(tmp_path, [body_pose(BODY, 0, 0.0, None, None), body_pose(BODY, 1, 0.1, any_pose(1), None)])
    assert np.isnan(table.head_m[0]).all()
    assert np.isfinite(table.head_m[1]).all()
    with pytest.raises(ValueError, match="lost"):
        pose_of(POINTS.asset, table.head_m[0], table.quaternion[0])


def test_axial_sigma_is_that_of_turns_about_the_bone():
    pose, knee = any_pose(3), MOVING_BONES.index("LeftLeg")
    bone = POINTS.asset.bone("LeftLeg")
    along = BODY.mesh.bone_tails[bone] - BODY.mesh.bone_heads[bone]
    axis = pose.rotations[bone] @ (along / np.linalg.norm(along))
    covariance = np.zeros((POSE_SIZE, POSE_SIZE))
    own = slice(3 * knee, 3 * knee + 3)
    covariance[own, own] = 0.04 * np.outer(axis, axis) + 0.09 * (np.eye(3) - np.outer(axis, axis))
    sigma = axial_sigma(BODY, pose, covariance, 0.5)
    assert sigma[knee] == pytest.approx(0.5 * 0.2)
    assert np.delete(sigma, knee).max() == 0.0


def test_anchors_come_back_and_a_missed_one_stays_missed(tmp_path):
    place, sigma = np.random.default_rng(2).normal(size=(5, 3)), np.full(5, 0.01)
    place[2], sigma[2] = np.nan, np.nan
    with write_anchors(tmp_path / "a.parquet") as table:
        table.append(AnchorFrame(4, 0.5, place, sigma))
    read = read_anchors(tmp_path / "a.parquet")
    np.testing.assert_array_equal(read.position_m[0], place)
    np.testing.assert_array_equal(read.sigma_m[0], sigma)


def test_labels_come_back_without_the_room(tmp_path):
    labels = np.random.default_rng(3).integers(0, 9, size=(40, 60)).astype(np.uint8)
    with write_people(tmp_path / "p.parquet") as table:
        table.append(encode_labels(3, "left", View(np.ones((40, 60), np.float32), labels)))
    read = decode_labels(read_people(tmp_path / "p.parquet")[3, "left"])
    np.testing.assert_array_equal(read, np.where(np.isin(labels, [0, 1, PixelLabel.CLUTTER]), ROOM, labels))


def test_tables_that_are_cut_off_are_refused(tmp_path):
    for name, write, row, read in (
        ("poses", write_poses, body_pose(BODY, 0, 0.0, any_pose(1), None), read_poses),
        ("anchors", write_anchors, AnchorFrame(0, 0.0, np.zeros((5, 3)), np.ones(5)), read_anchors),
    ):
        path = tmp_path / f"{name}.parquet"
        with write(path) as table:
            table.append(row)
        pq.write_table(pq.read_table(path).slice(1), path)
        with pytest.raises(InputError, match=name):
            read(path)


def test_two_pictures_of_one_frame_are_refused(tmp_path):
    picture = encode_labels(0, "front", View(np.ones((4, 4), np.float32), np.ones((4, 4), np.uint8)))
    with write_people(tmp_path / "p.parquet") as table:
        table.append(picture)
        table.append(picture)
    with pytest.raises(InputError, match="two pictures"):
        read_people(tmp_path / "p.parquet")
    assert isinstance(pq.read_table(tmp_path / "p.parquet"), pa.Table)


def write_pictures(path: Path, count: int) -> dict[tuple[int, str], LabelImage]:
    """Two cameras and some gaps, in an order that is not that of the names; packed bytes that say which they are."""
    made = [
        LabelImage(frame, camera, f"{camera} {frame}".encode() * 50)
        for frame in range(count)
        for camera in ("right", "front")
        if frame % 7 or camera == "front"
    ]
    with write_people(path) as table:
        for picture in made:
            table.append(picture)
    return {(picture.frame, picture.camera): picture for picture in made}


def spoil_last_pictures(path: Path) -> None:
    """Zeros over the pictures of the last row group."""
    group = pq.ParquetFile(path).metadata.row_group(pq.ParquetFile(path).num_row_groups - 1)
    column = group.column(2)
    start = column.dictionary_page_offset or column.data_page_offset
    content = bytearray(path.read_bytes())
    content[start : start + column.total_compressed_size] = bytes(column.total_compressed_size)
    path.write_bytes(content)


def test_pictures_are_found_one_by_one_as_if_all_were_read(tmp_path):
    made = write_pictures(tmp_path / "p.parquet", 500)
    assert read_people(tmp_path / "p.parquet") == made
    stored = StoredPeople(tmp_path / "p.parquet")
    for frame in np.random.default_rng(5).permutation(np.arange(-1, 502)).tolist():
        for camera in ("front", "right", "left"):
            assert stored.get(frame, camera) == made.get((frame, camera))


def test_only_the_pictures_around_the_one_that_is_asked_for_are_read(tmp_path):
    made = write_pictures(tmp_path / "p.parquet", 500)
    spoil_last_pictures(tmp_path / "p.parquet")
    stored = StoredPeople(tmp_path / "p.parquet")
    assert stored.get(3, "front") == made[3, "front"]
    with pytest.raises(InputError, match=r"p\.parquet"):
        stored.get(499, "front")


def test_stored_pictures_that_are_none_or_stand_twice_are_refused(tmp_path):
    write_pictures(tmp_path / "p.parquet", 300)
    table = pq.read_table(tmp_path / "p.parquet")
    pq.write_table(pa.concat_tables([table, table.slice(0, 1)]), tmp_path / "twice.parquet", row_group_size=50)
    with pytest.raises(InputError, match="two pictures"):
        StoredPeople(tmp_path / "twice.parquet").get(int(table["frame"][0].as_py()), "front")
    pq.write_table(table.drop(["labels"]), tmp_path / "other.parquet")
    with pytest.raises(InputError, match="its columns are not frame, camera, labels"):
        StoredPeople(tmp_path / "other.parquet")
    (tmp_path / "none.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match="not a parquet"):
        StoredPeople(tmp_path / "none.parquet")
