"""Convert recorders' files to a recording folder, image by image. A stopped conversion can be resumed; until the
conversion is complete, the folder is not a recording.

The file conversion.json in the recording folder identifies the inputs and options, so that the conversion can be
resumed or repeated.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from filelock import FileLock, Timeout

from anchorpose import __version__
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import ConvertOptions
from anchorpose.recording.recording import LEFT_OUT
from anchorpose.recording.recording_file import RECORDING_FILE
from anchorpose.recording.regular_file import open_regular
from anchorpose.recording.writable import check_place, new_folder
from anchorpose.results.folder import write_text_whole
from anchorpose.results.run_record import hash_files
from anchorpose.sources.grey_images import ImageFiles
from anchorpose.sources.plan import CameraPlan, CameraWriter, Plan, make_plan, turn_image
from anchorpose.sources.source import Source, find_reader, json_object, open_source
from anchorpose.threads import one_thread

CONVERSION_FILE: Final = "conversion.json"
LOCK_FILE: Final = ".conversion.lock"

BLOCK: Final = 65536  # size in bytes of a block: a piece of a large file that is hashed
BLOCKS: Final = 16  # number of hashed blocks of a large file; the sensor noise in them identifies a recording

SMALL: Final = 65536  # maximum size in bytes of a text file that is hashed whole
LISTED: Final = 200
"""Maximum number of text files in a folder that are hashed whole. Sizes alone would not show every change; for example,
correcting a lens may leave the size of a file unchanged.
"""

TEXTS: Final = {".json", ".txt", ".csv", ".yaml", ".yml"}


def conversion_document(inputs: Sequence[Path], options: ConvertOptions) -> dict[str, Any]:
    """Return the content of conversion.json, which identifies a conversion by the program's version, a hash of the
    inputs and the options.
    """
    prints = [(path, fingerprint(path)) for path in inputs]
    return {
        "format": "conversion",
        "version": 1,
        "anchorpose": __version__,
        "inputs": [{"name": path.resolve().name, "bytes": size, "sha256": sha256} for path, (size, sha256) in prints],
        "options": json.loads(json.dumps(asdict(options))),
    }


def read_conversion(folder: Path) -> dict[str, Any] | None:
    """Read the conversion.json of a folder; None if the folder has no readable conversion.json."""
    values = json_object(folder / CONVERSION_FILE)
    return values if values is not None and values.get("format") == "conversion" else None


def is_same(found: dict[str, Any], begun: dict[str, Any]) -> bool:
    """Return whether two conversion.json documents identify the same conversion: they state the same version of the
    program, the same options, and inputs with the same content. The inputs may have been renamed.
    """

    def identity(document: dict[str, Any]) -> tuple[Any, ...]:
        inputs = document.get("inputs")
        prints = [(one.get("bytes"), one.get("sha256")) for one in inputs] if isinstance(inputs, list) else None
        return prints, document.get("options"), document.get("anchorpose")

    return identity(found) == identity(begun)


def is_untouched(folder: Path) -> bool:
    """Return whether, according to file names and the content of recording.json, a folder with a conversion.json has
    only files that the conversion wrote. Such a folder can be converted again without loss of a user's work.
    """
    for file in folder.iterdir():
        of_camera = file.is_dir() and {inner.name for inner in file.iterdir()} <= {"depth", "timestamps.csv"}
        if not of_camera and file.name not in (RECORDING_FILE, CONVERSION_FILE, LOCK_FILE):
            return False
    document = folder / RECORDING_FILE
    if not document.exists():
        return True
    found, digest = read_conversion(folder), dict(hash_files([document], folder))
    return found is not None and found.get(RECORDING_FILE) == digest[RECORDING_FILE]


def fingerprint(path: Path) -> tuple[int, str]:
    """Return the size in bytes of a file or folder, and a SHA-256 of samples of its content and, for a folder, of the
    names and sizes of its files. Moving the file or folder does not change the result.
    """
    digest = hashlib.sha256()
    if path.is_file():
        _sample(path, digest)
        return path.stat().st_size, digest.hexdigest()
    parts = {file: file.relative_to(path).parts for file in sorted(path.rglob("*")) if file.is_file()}
    files = [file for file, names in parts.items() if not any(name.startswith(".") for name in names)]
    total = 0
    for file in files:
        size = file.stat().st_size
        digest.update(f"{file.relative_to(path).as_posix()} {size}\n".encode(errors="surrogateescape"))
        total += size
    texts = [file for file in files if file.suffix.lower() in TEXTS and file.stat().st_size <= SMALL]
    for file in [*texts[:LISTED], *files[:1], *files[-1:]]:
        _sample(file, digest)
    return total, digest.hexdigest()


def _sample(path: Path, digest: hashlib._Hash) -> None:
    size = path.stat().st_size
    digest.update(f"{size}\n".encode())
    starts = (
        range(0, size, BLOCK) if size <= BLOCK * BLOCKS else [k * (size - BLOCK) // (BLOCKS - 1) for k in range(BLOCKS)]
    )
    with open_regular(path) as file:
        for start in starts:
            file.seek(start)
            digest.update(file.read(BLOCK))


Progress = Callable[[int, int | None], None]

ENDING: Final = ".anchorpose"


@dataclass(frozen=True, slots=True)
class Converted:
    """The result of a conversion. cameras: (name, number of depth images); notes: sentences for the user."""

    cameras: tuple[tuple[str, int], ...]
    notes: tuple[str, ...]


def convert(inputs: Sequence[Path], out: Path, options: ConvertOptions, progress: Progress) -> Converted:
    """Write the recording ``out`` from recorders' files and folders; recording.json is written last.

    A stopped conversion of the same inputs with the same options is resumed. Raises InputError before anything is
    written if an input cannot be used, if information is missing that only the user can give, or if ``out`` has other
    content. progress is called with (done, total) images; total is None if unknown.
    """
    check_places(inputs, out)
    sources = [open_source(path) for path in inputs]
    plan = make_plan(sources, options)
    refusal: AnchorposeError | None = None
    with new_folder(out.resolve().parent, out):
        begun = conversion_document(inputs, options)
        with one_thread(), _claimed(out, begun):
            try:
                counts, notes = _write_images(sources, plan, out, options, progress)
            except AnchorposeError as error:
                refusal = error
            else:
                notes = (*(note for source in sources for note in source.notes), *notes)
                _finish(out, begun, plan, counts, notes)
        if refusal is not None:  # the input files cause this error, so the user is not advised to resume
            if is_untouched(out):
                shutil.rmtree(out)
            raise refusal
    return Converted(tuple((name, count) for name, count in counts.items() if count), (*notes, *plan.notes))


def check_places(inputs: Sequence[Path], out: Path) -> None:
    """Raise InputError if ``out`` cannot be written, or if an input is given twice or would be overwritten."""
    check_place(out, *inputs)
    sources = [path.resolve() for path in inputs]
    for path, source in zip(inputs, sources, strict=True):
        if sources.count(source) > 1:
            raise InputError(path, "is given twice", "give every input once")
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise InputError(out, "is a file or a link", "choose another name for the recording")
    if (out / RECORDING_FILE).exists():
        raise InputError(out, "is a finished recording", "choose another name, or remove it first")


@contextmanager
def _claimed(out: Path, begun: dict[str, Any]) -> Iterator[None]:
    """Lock ``out`` for this process and write its conversion.json; raises InputError if ``out`` has other content or
    another process has locked it.
    """
    if out.is_dir() and any(file.name != LOCK_FILE for file in out.iterdir()):
        found = read_conversion(out)
        if found is None:
            raise InputError(out, "exists and is not empty", "choose another name; nothing in it was touched")
        if not is_same(found, begun):
            problem = "was begun with other inputs, options or another version of anchorpose"
            raise InputError(out, problem, "choose another name, or remove it first")
    try:
        out.mkdir(parents=True, exist_ok=True)
        lock = FileLock(out / LOCK_FILE)
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(out, "is being written by another anchorpose", "wait until it has finished") from None
    except OSError as error:
        raise InputError(out, f"cannot be written ({error.strerror})", "choose a place that you may write to") from None
    try:
        write_text_whole(out / CONVERSION_FILE, _json(begun))
        yield
    finally:
        lock.release()
        with suppress(OSError):  # deleting fails if another process of anchorpose holds the lock file by now
            (out / LOCK_FILE).unlink()


def _write_images(
    sources: Sequence[Source], plan: Plan, out: Path, options: ConvertOptions, progress: Progress
) -> tuple[dict[str, int], tuple[str, ...]]:
    """Write all images; return each camera's number of images, and notes. Raises InputError if no image can be read."""
    counts, notes = dict[str, int](), list[str]()
    expected = [one.count for own in plan.cameras for one in own]
    total = None if None in expected else sum(count or 0 for count in expected)
    done = 0
    for source, cameras in zip(sources, plan.cameras, strict=True):
        with ExitStack() as stack:
            writers = [stack.enter_context(CameraWriter(out / own.camera.name, own)) for own in cameras]
            # per camera, the number of images up to the last image that the stopped conversion wrote
            to_skip = [writer.given for writer in writers]
            frames = source.frames()
            # A source whose images are all in one file can begin at any image. Sources of other kinds do not yield
            # damaged images, so the number of images to skip is not a position in them; their first images are read and
            # skipped.
            if isinstance(source, ImageFiles) and source.in_one_file:
                frames, done, to_skip = source.frames(to_skip[0]), done + to_skip[0], [0]
            progress(done, total)
            try:
                for frame in frames:
                    if to_skip[frame.camera] > 0:
                        to_skip[frame.camera] -= 1
                    else:
                        grey = turn_image(frame.depth, options.rotate, options.mirror)
                        writers[frame.camera].write(frame.time_s, grey)
                    done += 1
                    progress(done, total)
            except InputError as error:
                if not any(writer.written for writer in writers):
                    raise
                notes.append(f"Only a part could be read: {error.path.name}: {error.problem}; {error.remedy}.")
            notes += [note for writer in writers if (note := writer.note(source.path))]
        counts |= {own.camera.name: writer.written for own, writer in zip(cameras, writers, strict=True)}
        notes += _require_images(source, cameras, counts)
    return counts, tuple(notes)


def _require_images(source: Source, cameras: Sequence[CameraPlan], counts: dict[str, int]) -> list[str]:
    """Return a note for each camera without an image; raises InputError if no camera of the source has an image."""
    empty = [own.camera.name for own in cameras if not counts[own.camera.name]]
    if len(empty) == len(cameras):
        told = source.notes[-1].rstrip(".") if source.notes else "nothing says why"
        raise InputError(source.path, f"holds no depth image that can be used ({told})", "record or export it again")
    return [f"camera {name} {LEFT_OUT}it has no depth image." for name in empty]


def _finish(out: Path, begun: dict[str, Any], plan: Plan, counts: dict[str, int], notes: tuple[str, ...]) -> None:
    """Remove the folders of cameras without images, and write recording.json last: without it the folder is not a
    recording.

    notes: sentences on the images, which recording.json states, too. The notes of the plan are only in conversion.json,
    since they concern camera poses, which may be calibrated later.
    """
    cameras = [own.document() for group in plan.cameras for own in group if counts[own.camera.name]]
    for name, count in counts.items():
        if not count:
            shutil.rmtree(out / name)
    all_notes = [_plain(note) for note in (*notes, *plan.notes)]
    recorded: dict[str, Any] = {"notes": all_notes[: len(notes)]} if notes else {}
    text = _json({"format": "rgbd-recording", "version": 1, "cameras": cameras, "equipment": None, **recorded})
    made = {"notes": all_notes, RECORDING_FILE: hashlib.sha256(text.encode()).hexdigest()}
    write_text_whole(out / CONVERSION_FILE, _json({**begun, **made}))
    write_text_whole(out / RECORDING_FILE, text)


def _plain(note: str) -> str:
    """Return a note for a JSON file: without the full stop, and with a question mark in place of each character that a
    file's name may have but a text may not.
    """
    return "".join(each if each.isprintable() else "?" for each in note).rstrip(".")


def _json(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


class FoundRecording(NamedTuple):
    """The recording to use for a path that a user gave. ready: False if the path must be converted first, else True."""

    recording: Path
    ready: bool


def look_at(path: Path) -> FoundRecording:
    """Find the recording to use for the path that a user gave. It is the path itself if the path is a recording, or if
    no reader recognises it (``open_recording`` then reports the problem). Otherwise it is the path's conversion, which
    lies beside the path.

    An earlier conversion beside the path that was made from other content or by another version is removed. Raises
    InputError if files in that conversion were added or changed since, or if the conversion's name is taken by a link,
    or by a file or folder that is not a conversion.
    """
    if not path.exists() or (path / RECORDING_FILE).exists() or find_reader(path) is None:
        return FoundRecording(path, True)
    recording = _beside(path)
    if recording.is_symlink():
        raise InputError(recording, "is in the way and is a link", "rename it, or use 'anchorpose convert'")
    if not recording.is_dir() or not any(recording.iterdir()):
        return FoundRecording(recording, False)
    found = read_conversion(recording)
    if found is None:
        raise InputError(
            recording, "is in the way and was not made by anchorpose", "rename it, or use 'anchorpose convert'"
        )
    if is_same(found, conversion_document([path], ConvertOptions())):
        return FoundRecording(recording, (recording / RECORDING_FILE).exists())
    if not is_untouched(recording):
        problem = f"was made from another {path.name} or by another anchorpose, and has later additions or changes"
        raise InputError(recording, problem, "rename or remove it")
    shutil.rmtree(recording)
    return FoundRecording(recording, False)


def _beside(path: Path) -> Path:
    """Return the path of the recording that ``make_recording`` makes from ``path``, beside it."""
    return path.resolve().with_name(path.resolve().name + ENDING)


def make_recording(path: Path, progress: Progress) -> tuple[str, ...]:
    """Convert a file or folder into a recording beside it; return the notes. Raises InputError if the folder around it
    may not be written. A folder that is marked as read-only is refused even to administrators, whom the system would
    permit to write.
    """
    recording = _beside(path)
    folder = recording.parent
    marked = os.name == "posix" and not folder.stat().st_mode & 0o222
    if marked or not os.access(folder, os.W_OK):
        remedy = f"make the recording elsewhere with 'anchorpose convert {path.name} OUT'"
        raise InputError(folder, "cannot be written", remedy)
    return convert([path], recording, ConvertOptions(), progress).notes
