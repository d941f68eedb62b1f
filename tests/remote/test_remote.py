"""Addresses against real servers on this machine: what is read and written arrives whole, or is one sentence."""

import asyncio
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from anchorpose.cli import main
from anchorpose.errors import InputError, MissingPackage
from anchorpose.remote import is_address, local_copy, local_results, name_of


@pytest.fixture
def sftp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Path]]:
    """An address served by a real SFTP server that lets everybody in, and the folder that it serves."""
    with serving(tmp_path, monkeypatch, None, {"username": "test"}) as served:
        yield served


@contextmanager
def serving(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, password: str | None, given: dict[str, Any]
) -> Iterator[tuple[str, Path]]:
    """A real SFTP server; password: that it asks for, None for none; given: what the client is given beside the
    address."""
    asyncssh = pytest.importorskip("asyncssh", reason="sftp needs the package sshfs")
    pytest.importorskip("sshfs")
    served, loop, ready = tmp_path / "served", asyncio.new_event_loop(), threading.Event()
    served.mkdir()
    found: dict[str, Any] = {}

    class Door(asyncssh.SSHServer):
        def begin_auth(self, username: str) -> bool:
            return password is not None

        def password_auth_supported(self) -> bool:
            return True

        def validate_password(self, username: str, given: str) -> bool:
            return given == password

    async def serve() -> None:
        found["server"] = await asyncssh.listen(
            "127.0.0.1",
            0,
            server_factory=Door,
            server_host_keys=[asyncssh.generate_private_key("ssh-ed25519")],
            sftp_factory=lambda channel: asyncssh.SFTPServer(channel, chroot=str(served)),
        )
        ready.set()

    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    asyncio.run_coroutine_threadsafe(serve(), loop)
    assert ready.wait(20)
    import sshfs

    monkeypatch.setattr(sshfs.SSHFileSystem, "cachable", False)
    original = sshfs.SSHFileSystem._get_kwargs_from_urls  # the server has a new key each time
    monkeypatch.setattr(
        sshfs.SSHFileSystem,
        "_get_kwargs_from_urls",
        staticmethod(lambda path: original(path) | {"known_hosts": None} | given),
    )
    yield f"sftp://127.0.0.1:{found['server'].get_port()}", served

    async def end() -> None:
        found["server"].close()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()

    asyncio.run_coroutine_threadsafe(end(), loop).result(5)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(5)


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A bucket on a real server that speaks S3."""
    pytest.importorskip("s3fs", reason="s3 needs the package s3fs")
    moto = pytest.importorskip("moto.server", reason="the server of the test is moto, with flask")
    server = moto.ThreadedMotoServer("127.0.0.1", 0)
    server.start()
    _, port = server.get_host_and_port()
    for name, value in (
        ("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}"),
        ("AWS_ACCESS_KEY_ID", "test"),
        ("AWS_SECRET_ACCESS_KEY", "test"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    bucket = f"clinic-{port}"  # the server keeps buckets after it was stopped
    s3fs.S3FileSystem().mkdir(bucket)
    yield f"s3://{bucket}"
    server.stop()


@pytest.fixture(params=["sftp", "s3"])
def place(request: pytest.FixtureRequest) -> str:
    served = request.getfixturevalue(request.param)
    return served[0] if request.param == "sftp" else served


def write_tree(folder: Path, text: str = "1") -> Path:
    (folder / "front" / "depth").mkdir(parents=True)
    (folder / "recording.json").write_text(text)
    (folder / "front" / "depth" / "000000.png").write_bytes(bytes(range(256)) * 40)
    return folder


def tree(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def upload(folder: Path, address: str) -> None:
    with local_results(address) as made:
        folder.rename(made)


def test_what_goes_to_an_address_comes_back_the_same(place: str, tmp_path: Path) -> None:
    whole = tree(write_tree(tmp_path / "one"))
    upload(tmp_path / "one", f"{place}/one")
    with local_copy(f"{place}/one") as copy:
        assert (copy.name, tree(copy)) == ("one", whole)
    assert not copy.exists()


def test_what_is_at_an_address_is_never_replaced(place: str, tmp_path: Path) -> None:
    before = tree(write_tree(tmp_path / "one"))
    upload(tmp_path / "one", f"{place}/one")
    with pytest.raises(InputError, match="exists already"):
        upload(write_tree(tmp_path / "two", "2"), f"{place}/one")
    assert main(["track", str(tmp_path / "two"), "-o", f"{place}/one", "--overwrite"]) == 2
    with local_copy(f"{place}/one") as copy:
        assert tree(copy) == before


def test_work_that_fails_writes_nothing(place: str, tmp_path: Path) -> None:
    def fail() -> None:
        with local_results(f"{place}/half") as made:
            write_tree(made)
            raise ValueError

    with pytest.raises(ValueError, match=r"^$"):
        fail()
    with pytest.raises(InputError, match="is not there"), local_copy(f"{place}/half"):
        pass


def test_a_server_keeps_no_temporary_names(sftp: tuple[str, Path], tmp_path: Path) -> None:
    address, served = sftp
    upload(write_tree(tmp_path / "one"), f"{address}/one")
    assert [path.name for path in served.iterdir()] == ["one"]


@pytest.mark.parametrize("user", ["ben:wr%40ng", "ben:wr@ng", "ben"])
def test_a_wrong_password_or_key_is_one_sentence_without_the_password(user, tmp_path, monkeypatch, capfd) -> None:
    asyncssh = pytest.importorskip("asyncssh", reason="sftp needs the package sshfs")
    key = {"client_keys": [asyncssh.generate_private_key("ssh-ed25519")]} if user == "ben" else {}
    with serving(tmp_path, monkeypatch, "right", key | {"agent_path": None}) as (address, _):
        place = f"{address.replace('://', f'://{user}@')}/one"
        with pytest.raises(InputError, match=r"cannot be (read|written) \(.*check the address") as refused:
            upload(write_tree(tmp_path / "one"), place)
        assert main(["track", place, "-o", str(tmp_path / "out")]) == 2
    printed = "".join(capfd.readouterr())
    assert "cannot be read" in printed
    for text in (str(refused.value), printed):
        assert "ng@" not in text
        assert "wr%40ng" not in text
        assert "Traceback" not in text
    assert not (tmp_path / "out").exists()


def test_the_right_password_in_the_address_is_used(tmp_path, monkeypatch) -> None:
    with serving(tmp_path, monkeypatch, "r@ght", {"agent_path": None}) as (address, served):
        write_tree(served / "one")
        with local_copy(f"{address.replace('://', '://ben:r@ght@')}/one") as copy:
            assert tree(copy) == tree(served / "one")


def test_names_of_addresses_have_no_password() -> None:
    assert (name_of("sftp://user:secret@host"), name_of("sftp://user:se/cret@host/x")) == ("host", "x")
    assert (name_of("https://host/x?token=secret"), name_of("s3://bucket")) == ("x", "bucket")


def test_a_server_that_does_not_answer_is_one_sentence() -> None:
    pytest.importorskip("sshfs")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"sftp://127.0.0.1:{unused.getsockname()[1]}/one"
        with pytest.raises(InputError, match=f"{address}: cannot be read"), local_copy(address):
            pass


def test_an_address_without_its_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(address: str) -> None:
        raise ImportError

    monkeypatch.setattr("fsspec.core.url_to_fs", missing)
    with pytest.raises(MissingPackage, match=r"anchorpose\[gs\]"), local_copy("gs://bucket/one"):
        pass


def test_paths_are_used_as_they_are(tmp_path: Path) -> None:
    with local_copy(tmp_path) as same, local_results(tmp_path / "out") as out:
        assert (same, out) == (tmp_path, tmp_path / "out")
    assert not is_address("C:/data")
    assert not is_address(Path("s3://bucket"))
    assert name_of("sftp://host:22/a/b/") == "b"
