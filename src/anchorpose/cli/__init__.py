"""The command line: a few thin verbs. Heavy imports happen inside them, so that help is instant."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

from cyclopts import App, CycloptsError, Parameter

from anchorpose import __version__
from anchorpose.cli.calibrate import calibrate
from anchorpose.cli.check import check
from anchorpose.cli.convert import convert
from anchorpose.cli.demo import demo
from anchorpose.cli.equipment import equipment
from anchorpose.cli.evaluate import evaluate
from anchorpose.cli.experiment import experiment
from anchorpose.cli.export import export
from anchorpose.cli.inspect import inspect
from anchorpose.cli.measure import measure
from anchorpose.cli.motions import motions
from anchorpose.cli.report import report
from anchorpose.cli.simulate import simulate
from anchorpose.cli.track import track
from anchorpose.cli.view import view
from anchorpose.errors import AnchorposeError

EXIT_CANNOT, EXIT_INTERRUPTED, EXIT_TERMINATED = 2, 130, 143

app = App(
    name="anchorpose",
    version=__version__,
    help=(
        "Depth recordings of stand training to 21 joints over time, each with its state and its uncertainty.\n\n"
        "Start with 'anchorpose demo'. For research use; this is not a medical device."
    ),
    default_parameter=Parameter(negative=()),
    suppress_keyboard_interrupt=False,
)
for _verb in (
    demo, simulate, convert, check, calibrate, track, evaluate, measure, report, view, export, inspect, equipment,
    motions, experiment,
):  # fmt: skip
    app.command(_verb)


def main(tokens: Sequence[str] | None = None) -> int:
    """Runs a command line (that of the process by default) and returns its exit code; 0 is success."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        answer = app(tokens, exit_on_error=False, result_action="return_value")
    except CycloptsError:  # already printed, with the nearest known option
        return EXIT_CANNOT
    except AnchorposeError as error:
        return _refuse(str(error))
    except OSError as error:
        return _refuse(f"{error.filename or 'a file'}: {error.strerror or error}; check the disk and its permissions.")
    except KeyboardInterrupt:
        print("Stopped; nothing was written.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return answer if isinstance(answer, int) else 0


def _refuse(sentence: str) -> int:
    print(sentence, file=sys.stderr)
    return EXIT_CANNOT


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(EXIT_TERMINATED)  # unwinds, so that half-written folders are removed
