"""Define the command demo: simulate a patient, track the patient, and state the errors in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from anchorpose.cli.console import open_page, progress_bar, say
from anchorpose.errors import InputError

if TYPE_CHECKING:
    from anchorpose.results.evaluate import ErrorSummary, Evaluation

DEMO_SECONDS, QUICK_SECONDS = 3.0, 1.0
DEMO_SEED = 3  # a seed with which the patient, not the therapist, is nearest to the camera at the start
# Frames per second; enough for slow movements, and tracking takes half as long as at 30 frames per second
DEMO_FPS = 15.0


def demo(
    out: Path = Path("anchorpose-demo"), /, *, quick: bool = False, tables: bool = False, no_open: bool = False
) -> None:
    """Show how the program works: simulate and track a patient in a standing frame, and compare with the true joints.

    The demo takes one to two minutes, longer the first time, and needs no recording.

    Parameters
    ----------
    out
        The folder to write.
    quick
        Simulate only one second, to check an installation.
    tables
        Also print the errors of every joint and angle.
    no_open
        Do not open the report in the browser.
    """
    from anchorpose.recording.writable import check_place

    check_place(out)
    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise InputError(out, "exists already", "choose another name or remove it first")
    seconds = QUICK_SECONDS if quick else DEMO_SECONDS
    # printed before the imports, which take seconds
    say(f"1. Simulating {seconds:g} s of a patient in a standing frame, one camera, one therapist.")
    from anchorpose.cli.evaluate_verbs import print_evaluation
    from anchorpose.report.page import REPORT_FILE

    evaluation = _simulate_and_track(out, seconds)
    if tables:
        print_evaluation(evaluation)
    _print_account(evaluation, out)
    report = out / "results" / REPORT_FILE
    opened = not no_open and open_page(report)
    say(f"The report is {'open in the browser' if opened else 'a page for the browser'}: {report}")


def _simulate_and_track(out: Path, seconds: float) -> Evaluation:
    """Write the recording, its results and their errors into ``out``, which appears when everything is complete."""
    from anchorpose.pipeline import track_recording
    from anchorpose.results.evaluate import evaluate
    from anchorpose.results.evaluation_file import write_evaluation
    from anchorpose.results.folder import whole_or_nothing
    from anchorpose.simulate.config import SimulationConfig
    from anchorpose.simulate.write import simulate_recording
    from anchorpose.tracker.config import TrackConfig
    from anchorpose.tracker.warm_up import start_warm_up

    scene = SimulationConfig(seed=DEMO_SEED, seconds=seconds, fps=DEMO_FPS, cameras=1, therapists=1, speed="slow")
    start_warm_up()  # compiles kernels on another core, while this process simulates
    with whole_or_nothing(out) as folder:
        simulated, results = folder / "simulated", folder / "results"
        with progress_bar("Simulating") as progress:
            simulate_recording(simulated, scene, progress)
        say("2. Tracking 21 joints; the first run takes longer, because it compiles.")
        results.mkdir()
        with progress_bar("Tracking") as progress:
            track_recording(simulated / "recording", results, TrackConfig(), progress)
        say("3. Comparing with the true joints, which a real recording does not have.")
        evaluation = evaluate(results, simulated / "truth" / "truth.npz")
        write_evaluation(folder / "evaluation.json", evaluation)
    return evaluation


def _print_account(evaluation: Evaluation, out: Path) -> None:
    """Print the accuracy of the demo in words, and the commands that the user may run next."""
    say("")
    for sentence in account(evaluation):
        say(sentence)
    say("")
    results, simulated = out / "results", out / "simulated"
    say(f"Every joint and angle: anchorpose evaluate {results} --truth {simulated / 'truth' / 'truth.npz'}")
    say(f"Every frame:           anchorpose view {results} {simulated / 'recording'}")
    say("A recording of yours:  anchorpose track RECORDING -o RESULTS")


def account(evaluation: Evaluation) -> list[str]:
    """Return the findings of an evaluation, one sentence per item; a sentence whose figures are unknown is left out."""
    from anchorpose.results.evaluation_file import longest_error_sentence

    return [
        *_accuracy(evaluation),
        *_seen_and_inferred(evaluation),
        *_joints(evaluation.per_joint),
        *_knees(evaluation),
        *_uncertainty(evaluation.overall.coverage_95),
        longest_error_sentence(evaluation),
    ]


def _accuracy(evaluation: Evaluation) -> Iterator[str]:
    errors = evaluation.overall
    if errors.mean_mm is not None and errors.p95_mm is not None:
        yield f"Joints are {errors.mean_mm:.0f} mm off on average; 95 of 100 are at most {errors.p95_mm:.0f} mm off."
    if errors.lost_share:
        yield f"{100 * errors.lost_share:.0f} % of the joints are lost: these have no position."


def _seen_and_inferred(evaluation: Evaluation) -> Iterator[str]:
    """Yield a sentence on seen joints and a sentence on inferred joints, with their share and their mean error."""
    for words, errors in (("seen", evaluation.observed), ("hidden and inferred", evaluation.hidden)):
        if errors.mean_mm is not None:
            share = 100 * errors.joint_frames / evaluation.overall.joint_frames
            yield f"{share:.0f} % of the joints were {words}: {errors.mean_mm:.0f} mm off on average."


def _joints(per_joint: Iterable[tuple[str, ErrorSummary]]) -> Iterator[str]:
    from anchorpose.report.words import named_part

    known = sorted((errors.mean_mm, named_part(name)) for name, errors in per_joint if errors.mean_mm is not None)
    if known:
        (least, best), (most, worst) = known[0], known[-1]
        yield f"The best joint is the {best} ({least:.0f} mm), the worst the {worst} ({most:.0f} mm)."


def _knees(evaluation: Evaluation) -> Iterator[str]:
    angles = dict(evaluation.angles)
    left, right = (angles[f"knee_flexion_{side}"].mean_abs_deg for side in ("left", "right"))
    if left is not None and right is not None:
        yield f"Knee flexion is {left:.1f} degrees off on the left and {right:.1f} on the right."


def _uncertainty(coverage: float | None) -> Iterator[str]:
    if coverage is not None:
        yield f"The stated uncertainty covers the true position on {100 * coverage:.0f} of 100 axes; 95 is exact."
