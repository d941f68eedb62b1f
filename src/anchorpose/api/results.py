"""Open a results folder as pandas data frames, as arrays, or as an xarray dataset for other programs."""

from __future__ import annotations

from copy import deepcopy
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.errors import InputError, MissingPackage
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.recording.document import read_json
from anchorpose.results.parquet import read_any_parquet
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JointTable, read_joints

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

PATIENT: Final = "patient"
WITHIN_M: Final = 0.1  # m; ``confidence`` is the probability of a joint error below this; larger errors affect measures
# as a share of the median interval between frames: if the longest and the shortest interval differ by less than this,
# the frames count as evenly spaced, and the dataset gets the attribute ``fps``
EVEN: Final = 0.01


class Results:
    """An open results folder. Each table is read when it is requested for the first time. Missing values stay missing
    (NaN or None).

    folder: the path of the results. If ``track`` was called without a folder, this is a temporary folder that exists as
    long as this object lives.
    """

    folder: Path

    def __init__(self, folder: Path, kept: TemporaryDirectory[str] | None = None) -> None:
        """Open a results folder; raises InputError if the folder has no results."""
        self.folder, self._kept = folder, kept
        if not (folder / RUN_FILE).is_file():
            raise InputError(folder, "is not a results folder", "give a folder that 'anchorpose track' has written")

    def __repr__(self) -> str:
        return f"Results({str(self.folder)!r})"

    @cached_property
    def run(self) -> dict[str, Any]:
        """Return the content of run.json: versions, settings, cameras, the learnt body, notes (docs/guide/track.md)."""
        return dict(read_json(self.folder / RUN_FILE))

    @cached_property
    def joints(self) -> pd.DataFrame:
        """Return a table with a row for each joint of each frame: frame, time_s, joint, x_m, y_m, z_m (world), state,
        sigma_m.
        """
        return self._frame("joints")

    @cached_property
    def angles(self) -> pd.DataFrame:
        """Return a table with a row for each angle of each frame, in degrees (docs/angles.md)."""
        return self._frame("angles")

    @cached_property
    def measures(self) -> pd.DataFrame:
        """Return a table with a row for each clinical measure (docs/measures.md) of the whole recording; if the results
        have trials, also with a row for each measure of each trial and condition.
        """
        return self._frame("measures")

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """Return a table with a row for each interval in which the patient was upright, stood up, sat down or swung a
        foot, and for each event: a knee that buckled, a stand that failed, a recovery step.
        """
        return self._frame("episodes")

    @cached_property
    def posture(self) -> pd.DataFrame:
        """Return a table with a row for each frame: the centre of mass, and whether the patient is upright."""
        return self._frame("posture")

    @cached_property
    def contacts(self) -> pd.DataFrame:
        """Return a table with a row for each contact of another person, or of a part of the equipment, with a part of
        the patient.
        """
        return self._frame("contacts")

    @cached_property
    def joint_table(self) -> JointTable:
        """Return the joints as arrays: position_m (n, 21, 3), sigma_m (n, 21), states."""
        return read_joints(self.folder / "joints.parquet")

    def to_xarray(self) -> xr.Dataset:
        """Return the joints as a dataset in the convention of the package ``movement`` for poses.

        position (time, space, keypoints, individuals) metres, world; confidence (time, keypoints, individuals): the
        probability, computed from sigma, that the error is below 10 cm. sigma (metres, along each axis) and state have
        the shape of confidence. Numbers are NaN where a joint is lost. Raises MissingPackage if xarray is missing.
        """
        try:
            import xarray as xr
        except ImportError:
            raise MissingPackage("A dataset", "xarray", "frames") from None
        from scipy.stats import chi2

        table = deepcopy(self.joint_table)  # so that a change to the dataset does not change ``joint_table``
        joint = ("time", "keypoints", "individuals")
        states = np.array([str(state) for state in JointState])[table.state_code]
        near = chi2.cdf((WITHIN_M / table.sigma_m) ** 2, df=3)
        attributes: dict[str, Any] = {"source_software": f"anchorpose {__version__}", "ds_type": "poses"}
        attributes |= {"source_file": str(self.folder), "time_unit": "seconds"}
        step_s = np.diff(table.time_s)
        if len(step_s) and np.ptp(step_s) < EVEN * np.median(step_s):
            attributes["fps"] = float(1.0 / np.median(step_s))
        return xr.Dataset(
            {
                "position": (
                    ("time", "space", "keypoints", "individuals"),
                    table.position_m.transpose(0, 2, 1)[..., None],
                ),
                "confidence": (joint, near[..., None]),
                "sigma": (joint, table.sigma_m[..., None]),
                "state": (joint, states[..., None]),
            },
            coords={
                "time": table.time_s,
                "space": ["x", "y", "z"],
                "keypoints": list(JOINT_NAMES),
                "individuals": [PATIENT],
            },
            attrs=attributes,
        )

    def _frame(self, table: str) -> pd.DataFrame:
        try:
            import pandas  # noqa: F401
        except ImportError:
            raise MissingPackage("A data frame", "pandas", "frames") from None
        return read_any_parquet(self.folder / f"{table}.parquet").to_pandas()
