"""From the joints of a results folder to its angles, posture, episodes and measures."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from anchorpose.results.angles import ANGLES_FILE, write_angles
from anchorpose.results.angles_processed import PROCESSED_FILE, ProcessedAngles, write_processed_angles
from anchorpose.results.contacts import CONTACTS_FILE, read_contacts
from anchorpose.results.episodes import EPISODES_FILE, write_episodes
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.measures import MEASURES_FILE, Measure, write_measures
from anchorpose.results.posture import POSTURE_FILE, write_posture
from anchorpose.results.processing.policy import ProcessingConfig
from anchorpose.results.processing.process import process_angles
from anchorpose.results.stand_training.measure import MeasureConfig, measure_session
from anchorpose.results.tables import JOINTS_FILE, read_joints


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """All measures; processed: the smoothed or filled angles, None where nothing of that was asked for."""

    measures: tuple[Measure, ...]
    processed: ProcessedAngles | None


def write_measured(results: Path, processing: ProcessingConfig, config: MeasureConfig) -> Measured:
    """Writes angles, posture, episodes and measures of a results folder, and the processed angles where asked for.

    Angles and measures always come from the joints as tracked: ``processing`` makes angles_processed.parquet and
    nothing else, and that file goes away where no processing is asked for. All files are written before the first is
    replaced.
    Raises InputError where joints or contacts cannot be used, AnchorposeError where the filter does not fit.
    """
    joints = read_joints(results / JOINTS_FILE)
    contacts = read_contacts(results / CONTACTS_FILE) if (results / CONTACTS_FILE).exists() else None
    angles = joint_angles(joints)
    processed = process_angles(joints, processing) if processing.asked_for else None
    session, measures = measure_session(joints, angles, contacts, config)
    work = Path(tempfile.mkdtemp(prefix=".measuring-", dir=results))
    try:
        write_angles(work / ANGLES_FILE, angles)
        write_posture(work / POSTURE_FILE, session.posture)
        write_episodes(work / EPISODES_FILE, session.episodes)
        write_measures(work / MEASURES_FILE, measures, asdict(config))
        if processed is not None:
            write_processed_angles(work / PROCESSED_FILE, processed)
        for written in sorted(work.iterdir()):
            written.replace(results / written.name)
        if processed is None:
            (results / PROCESSED_FILE).unlink(missing_ok=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return Measured(tuple(measures), processed)
