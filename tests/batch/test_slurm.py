"""``--scheduler slurm`` with stand-ins for the programs of SLURM, which run a job on this machine."""

import os
from functools import partial
from pathlib import Path

import batch_stub
import pytest

from anchorpose.batch.cluster import SLURM, Job, Place, run_jobs
from anchorpose.errors import AnchorposeError

SBATCH = """#!/bin/sh
cp "$1" "{folder}/job.sh"  # the caller removes its own when this ends
setsid sh "{folder}/job.sh" > "{folder}/worker.log" 2>&1 &
echo $! >> "{folder}/started"
echo "Submitted batch job $!"
"""
SCANCEL = "#!/bin/sh\n"  # the worker ends by itself when its scheduler does


def test_jobs_run_on_workers_that_slurm_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue", reason="slurm needs the package dask-jobqueue")
    for name, text in (("sbatch", SBATCH.format(folder=tmp_path)), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    builders = str(Path(batch_stub.__file__).parent)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (builders, os.environ.get("PYTHONPATH")))))
    settings = {"queue": "clinic", "walltime": "00:10:00", "interface": "lo", "local_directory": str(tmp_path)}
    place = Place(workers=1, scheduler=SLURM, slurm=settings)
    (outcome,) = run_jobs([Job("a", partial(batch_stub.threads, tmp_path / "threads"))], place)
    assert (outcome.why, (tmp_path / "threads").read_text()) == (None, "1 1")
    assert len((tmp_path / "started").read_text().split()) == 1


def test_settings_that_slurm_does_not_know_and_slurm_that_is_not_there_are_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("dask_jobqueue", reason="slurm needs the package dask-jobqueue")
    with pytest.raises(AnchorposeError, match="settings for SLURM cannot be used"):
        list(run_jobs([Job("a", print)], Place(scheduler=SLURM, slurm={"quue": "clinic"})))
    monkeypatch.setattr("anchorpose.batch.cluster.which", lambda name: None)
    place = Place(scheduler=SLURM, slurm={"interface": "lo"})
    with pytest.raises(AnchorposeError, match="needs SLURM's program sbatch"):
        list(run_jobs([Job("a", print)], place))
