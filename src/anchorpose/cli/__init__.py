"""Define the command line. Commands import heavy modules only when they run, so that help is printed at once."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Final, NoReturn

from cyclopts import App, CycloptsError, Group, Parameter

from anchorpose import __version__
from anchorpose.cli.console import say
from anchorpose.cli.demo_verb import demo
from anchorpose.cli.evaluate_verbs import evaluate, reliability
from anchorpose.cli.live_verbs import live, record
from anchorpose.cli.recording_verbs import calibrate, check, convert, equipment, motions
from anchorpose.cli.research_verbs import benchmark, experiment
from anchorpose.cli.results_verbs import export, measure, report, sync, verify
from anchorpose.cli.settings_file import fill_from_file
from anchorpose.cli.simulation_verbs import simulate
from anchorpose.cli.track_verbs import batch, track
from anchorpose.cli.viewing_verbs import inspect, view
from anchorpose.errors import AnchorposeError, InputError, is_utf8

EXIT_CANNOT: Final = 2
EXIT_SIGNAL: Final = 128  # exit code = this + the signal's number: 130 after Ctrl+C, 143 if the system ends the process
STOPPING: Final = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Stopped(KeyboardInterrupt):
    """A signal that ends the process. It is raised as an exception, so that each function on the call stack cleans up:
    half-written folders are removed, or kept so that a later run can continue.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


app = App(
    name="anchorpose",
    version=__version__,
    help=(
        "Turn depth recordings of stand training into 21 joints over time, each with state and uncertainty.\n\n"
        "Start with 'anchorpose demo'. For research use; this is not a medical device."
    ),
    default_parameter=Parameter(negative=()),
    config=fill_from_file,
    suppress_keyboard_interrupt=False,
)
GROUPS: Final = {
    "From recordings to results": (
        convert,
        check,
        calibrate,
        track,
        view,
        measure,
        report,
        export,
        sync,
        live,
        record,
        batch,
    ),
    "Compare": (evaluate, reliability, verify),
    "Set up": (equipment, motions, inspect),
    "Try out and research": (demo, simulate, experiment, benchmark),
}
for _place, (_title, _verbs) in enumerate(GROUPS.items()):
    _group = Group(_title, sort_key=_place)
    for _verb in _verbs:
        if isinstance(_verb, App):  # a command with subcommands
            _verb.group = _group
            app.command(_verb)
        else:
            app.command(_verb, group=_group)
app.register_install_completion_command()


def main(tokens: Sequence[str] | None = None) -> int:
    """Run a command line (by default, the command line of the process) and return its exit code; 0 is success."""
    given = sys.argv[1:] if tokens is None else tokens

    def work() -> object:
        for token in given:  # neither tables nor JSON can hold a file's name that is not text
            if not is_utf8(token):
                raise InputError(token, "is not text in UTF-8", "rename the file, or write the text in UTF-8")
        return app(given, exit_on_error=False, print_error=False, result_action="return_value")

    return exit_code_of(work)


def exit_code_of(work: Callable[[], object]) -> int:
    """Call ``work``, which runs a command, and return the exit code of the process. An error that ends the work is
    printed as one sentence on the error stream.
    """
    for number in STOPPING:
        signal.signal(number, _stop)
    try:
        answer = work()
    except CycloptsError as error:  # the text of this error names the nearest known option
        return _refuse(" ".join(str(error).split()), error)
    except AnchorposeError as error:
        return _refuse(str(error), error)
    except OSError as error:
        sentence = f"{error.filename or 'a file'}: {error.strerror or error}; check the disk and its permissions."
        return _refuse(sentence, error)
    except (KeyboardInterrupt, SystemError) as error:
        number = _signal_of(error)
        if number is None:
            raise
        say(" ".join(("Stopped.", *(_notes(error) or ("Nothing was written.",)))), error=True)
        return EXIT_SIGNAL + number
    return answer if isinstance(answer, int) else 0


def _refuse(sentence: str, error: Exception) -> int:
    say(" ".join((sentence, *_notes(error))), error=True)
    return EXIT_CANNOT


def _notes(error: BaseException) -> tuple[str, ...]:
    """Return the notes that ``unfinished_results`` adds to an error: which files are left behind, how to continue."""
    return tuple(getattr(error, "__notes__", ()))


def _signal_of(error: BaseException | None) -> int | None:
    """Return the number of the signal that caused an error; None if no signal did.

    A signal that arrives while a compiled kernel runs is raised as a SystemError.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return None if error is None else getattr(error, "number", int(signal.SIGINT))


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    raise Stopped(number)
