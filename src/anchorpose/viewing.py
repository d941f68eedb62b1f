"""From a results folder to a page in the browser, until it is stopped."""

from __future__ import annotations

from pathlib import Path

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.results.corrections import corrections_beside, corrections_of_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.viewer.correcting import Correcting
from anchorpose.viewer.desk import Desk
from anchorpose.viewer.review import open_review
from anchorpose.viewer.server import ViewerServer


def open_viewer(
    results: Path, recording: Path | None, corrections: Path | None, who: str, host: str, port: int
) -> ViewerServer:
    """A server that listens; raises InputError where results, recording or corrections cannot be used, AnchorposeError
    where nothing can listen on ``host`` and ``port``.

    corrections: the file to extend; None = beside the results (``corrections_beside``). A file that is not there yet
    begins with the corrections that the results were tracked with.
    """
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    review = open_review(results, recording)
    path = corrections if corrections is not None else corrections_beside(results)
    desk = Desk(review, Correcting(path, corrections_of_run(results / RUN_FILE, review.run), review.joints), who)
    try:
        return ViewerServer(desk, host, port)
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        sentence = f"Cannot listen on {host}, port {port} ({why}); choose another --host or --port."
        raise AnchorposeError(sentence) from None
