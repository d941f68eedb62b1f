"""``anchorpose view``."""

from __future__ import annotations

from pathlib import Path


def view(
    results: Path,
    recording: Path | None = None,
    /,
    *,
    corrections: Path | None = None,
    who: str = "",
    host: str = "127.0.0.1",
    port: int = 0,
    no_browser: bool = False,
) -> None:
    """Look at results in the browser, and mark what is wrong with them.

    Plays the patient's skeleton and body at recorded speed, with the depth cameras' points around them and the angle
    curves beside. Press ? in the page for all keys. What you mark (parts of the recording that are unusable, joints
    that are elsewhere) is saved at once; 'anchorpose track --corrections FILE' honours it. Nothing leaves this
    computer. Stop with Ctrl+C.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording that the results were made of; without it only skeleton, body and curves are shown.
    corrections
        The file that your corrections are added to; the default is RESULTS.corrections.json, beside the folder. A new
        file begins with the corrections that the results were tracked with.
    who
        Your initials or pseudonym, for the corrections; otherwise the page asks you once.
    host
        Where to listen. Any other address than the default lets other computers look at the patient: they need the
        whole printed address, which holds a secret.
    port
        The port to listen on; the default is a free one.
    no_browser
        Print the address only.
    """
    from contextlib import nullcontext

    from anchorpose.viewer.opening import opened_page
    from anchorpose.viewer.server import is_loopback
    from anchorpose.viewing import open_viewer

    with open_viewer(results, recording, corrections, who, host, port) as server:
        try:
            print(f"The viewer is at {server.address}", flush=True)
            if not is_loopback(host):
                print("Whoever has this address can see the patient and change the corrections, without encryption.")
            print(f"Corrections go to {server.desk.correcting.path}. Stop with Ctrl+C.", flush=True)
            with nullcontext() if no_browser else opened_page(server.address):
                server.serve_forever()
        except KeyboardInterrupt:
            print("\nStopped; every correction was saved when it was made.")
