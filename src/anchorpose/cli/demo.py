"""``anchorpose demo``."""

from __future__ import annotations

from pathlib import Path

from anchorpose.cli.console import say
from anchorpose.errors import InputError

DEMO_SECONDS, QUICK_SECONDS = 3.0, 1.0
DEMO_SEED = 3  # a scene in which the patient, and no therapist, stands nearest to the camera at the start
DEMO_FPS = 15.0  # enough for slow movements, and half the work of 30


def demo(out: Path = Path("anchorpose-demo"), /, *, quick: bool = False) -> None:
    """See it work: a simulated patient in a standing frame is recorded, tracked and compared with the true joints.

    Takes one to two minutes, longer the first time, and needs nothing but this program.

    Parameters
    ----------
    out
        The folder to write.
    quick
        One second of recording only, to check an installation.
    """
    from anchorpose.cli.console import print_outcome, progress_bar
    from anchorpose.cli.evaluate import print_evaluation
    from anchorpose.pipeline import track_recording
    from anchorpose.results.evaluate import evaluate
    from anchorpose.results.evaluation_file import write_evaluation
    from anchorpose.results.folder import whole_or_nothing
    from anchorpose.simulate.config import SimulationConfig
    from anchorpose.simulate.write import simulate_recording
    from anchorpose.tracker.config import TrackConfig
    from anchorpose.tracker.warm_up import start_warm_up

    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise InputError(out, "exists already", "choose another name or remove it first")
    seconds = QUICK_SECONDS if quick else DEMO_SECONDS
    scene = SimulationConfig(seed=DEMO_SEED, seconds=seconds, fps=DEMO_FPS, cameras=1, therapists=1, speed="slow")
    start_warm_up()  # on another core, while this process simulates
    with whole_or_nothing(out) as folder:
        simulated, results = folder / "simulated", folder / "results"
        say(f"1. Simulating {scene.frames} frames of a patient in a standing frame, one camera, one therapist.")
        with progress_bar("Simulating") as progress:
            simulate_recording(simulated, scene, progress)
        say("2. Tracking 21 joints; the first run takes longer, because it compiles.")
        results.mkdir()
        with progress_bar("Tracking") as progress:
            track_recording(simulated / "recording", results, TrackConfig(), progress)
        say("3. Comparing with the true joints, which a real recording does not have.")
        evaluation = evaluate(results, simulated / "truth" / "truth.npz")
        write_evaluation(folder / "evaluation.json", evaluation)
    print_evaluation(evaluation)
    print_outcome(out / "results")
    say(f"The recording is {out / 'simulated' / 'recording'}, the figures above are {out / 'evaluation.json'}.")
