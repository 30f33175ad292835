"""Making the environment: the program that the button starts, with a tiny wheel instead of gigabytes."""

from __future__ import annotations

import http.server
import os
import shutil
import signal
import ssl
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from blender_addon.worker import environment
from blender_addon.worker.interpreter import venv_python
from blender_addon.worker.jobs import Job
from tests.app.test_endings import alive, until
from tests.blender_addon.tiny_wheel import locked, tiny_core, tiny_wheel

PROGRAM = environment.__file__


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    """pip is cut off here, so the step that renews pip fails; the rest must come about all the same."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)


def job(folder: Path, wanted: str) -> Job:
    return Job([sys.executable, "-I", "-u", PROGRAM, str(folder), wanted])


def any_of_group(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_failure_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    """Another, a package that is not there, is tried through the button."""
    wanted = tiny_wheel(tmp_path, 'raise RuntimeError("built for another machine")\n')
    state = job(tmp_path / "environment", str(wanted)).wait(90)
    assert state.status == "failed" and "RuntimeError: built for another machine" in state.error
    assert "\n" not in state.error and not (tmp_path / "environment").exists()


def test_a_finished_environment_outlives_a_failed_one(tmp_path: Path) -> None:
    folder = tmp_path / "environment"
    folder.mkdir()
    (folder / environment.READY).write_text("")
    (folder / "mine").write_text("made before")
    running = job(folder, str(tiny_wheel(tmp_path)))
    assert until(lambda: running.drain().running and (folder / "pyvenv.cfg").exists(), 30)
    assert running.end().status == "cancelled"
    environment.remove_unfinished(folder)
    assert environment.is_ready(folder) and (folder / "mine").read_text() == "made before"
    state = job(folder, str(tiny_wheel(tmp_path))).wait(90)
    assert state.status == "done", list(state.log)
    assert state.ended == {"environment": "done"} and environment.is_ready(folder)
    assert not (folder / "mine").exists() and not (folder / "temporary").exists()
    assert [p.name for p in tmp_path.iterdir() if p.is_dir()] == ["environment"]
    assert any("installing unveil" in line for line in state.log)
    assert any(line.endswith("Processing unveil_core 0.1.0") for line in state.log)
    python = venv_python(folder)
    said = subprocess.run(
        [python, "-c", "import unveil_core as u; print(u.__version__)"], capture_output=True, text=True
    )
    assert said.stdout == "0.1.0\n"
    assert not environment.remove_unfinished(folder) and python.exists()


def test_pip_leaves_nothing_where_it_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it downloads and unpacks lies in the environment's folder, which goes."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    folder = tmp_path / "environment"
    running = job(folder, str(tiny_wheel(tmp_path)))
    assert until(lambda: running.drain().running and any(folder.glob("temporary/pip-*")), 60)
    os.killpg(running.pid, signal.SIGKILL)
    assert running.wait(5).status == "failed" and environment.remove_unfinished(folder)
    assert not list(temporary.iterdir())


@pytest.mark.parametrize("sign", ["", "pyvenv.cfg"])
def test_it_ends_with_who_started_it(sign: str, tmp_path: Path) -> None:
    """At once, when it has hardly begun, and while a command of a command works."""
    folder = tmp_path / "environment"
    process = subprocess.Popen(
        [sys.executable, "-I", "-u", PROGRAM, str(folder), str(tiny_wheel(tmp_path))],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    assert until(lambda: not sign or any(folder.glob(sign)), 60)
    process.stdin.close()
    assert until(lambda: process.poll() is not None, 10) and not alive(process.pid)
    assert process.returncode == 130 and not folder.exists()
    assert until(lambda: not any_of_group(process.pid), 2)  # who was ended may lie there until somebody looks


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no certificate can be made")
def test_a_network_that_opens_connections_is_told_from_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a server whose certificate nobody has signed, as of a company that inspects what goes out."""
    made = ["-subj", "/CN=127.0.0.1", "-keyout", str(tmp_path / "key.pem"), "-out", str(tmp_path / "certificate.pem")]
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *made], check=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "certificate.pem", tmp_path / "key.pem")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), http.server.SimpleHTTPRequestHandler)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.delenv("PIP_NO_INDEX")
    monkeypatch.setenv("PIP_INDEX_URL", f"https://127.0.0.1:{server.server_address[1]}/simple")
    monkeypatch.setenv("PIP_RETRIES", "0")
    try:
        state = job(tmp_path / "environment", "street_shapes==1.0").wait(120)
    finally:
        server.shutdown()
        server.server_close()
    assert state.status == "failed" and "street_shapes==1.0 was not found in the package index" in state.error
    assert (
        "its certificate is not trusted" in state.error and "PIP_CERT" in state.error and "is there" not in state.error
    )


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (
            "SSLError(SSLCertVerificationError(1, '[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed'))",
            "certificate",
        ),
        (
            "ProxyError('Cannot connect to proxy.', OSError('Tunnel connection failed: 407 Proxy Authentication Required'))",
            "proxy",
        ),
        (
            "Failed to establish a new connection: [Errno -3] Temporary failure in name resolution",
            "there is no network",
        ),
        ("ERROR: HTTP error 403 while getting: 403 Client Error: Forbidden for url", "refuses the request"),
        ("Collecting numpy", ""),
    ],
)
def test_what_pip_says_of_the_connection_is_understood(line: str, told: str) -> None:
    found = environment._network_trouble(line)
    assert (told in found) if told else found == ""


def test_what_is_installed(tmp_path: Path) -> None:
    assert (environment.ADDON / "blender_manifest.toml").is_file()
    with pytest.raises(LookupError, match="came without unveil_core"):  # and nobody else's is taken for it
        environment.requirement(addon=tmp_path)
    tiny_wheel(tmp_path / "core")
    with pytest.raises(LookupError, match="without the hashes"):
        environment.requirement(addon=tmp_path)
    wheel = tiny_core(tmp_path)
    assert environment.requirement(addon=tmp_path) == str(wheel) and environment.locks(tmp_path) == wheel.parent
    assert environment.requirement(" ../source ", addon=tmp_path) == "../source"
    with pytest.raises(LookupError, match="Install From begins with //"):  # and leads to beside a stranger's file
        environment.requirement("//unveil.whl", addon=tmp_path)
    with pytest.raises(LookupError, match="Folder of Wheels begins with //"):
        environment.wheels_folder("//wheels", "unveil")


class Index:
    """Packages that pip finds, and an add-on whose lock files list them. ``street-shapes`` needs what nobody has."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.packages = folder / "packages"
        shapes = self.put("street_shapes", requires=("not-in-the-lock",))
        torch, cuda = self.put("torch", "2.13.0", requires=("nvidia-tiny",)), self.put("nvidia_tiny")
        self.addon = folder / "a folder"
        self.wheel = tiny_core(self.addon, core=locked(shapes), torch=locked(torch), cuda=locked(cuda))
        monkeypatch.setenv("PIP_FIND_LINKS", str(self.packages))

    def put(self, name: str, version: str = "1.0", text: str = "", requires: tuple[str, ...] = ()) -> Path:
        return tiny_wheel(self.packages, text, name, version, requires)

    def job(self, folder: Path, *options: str) -> Job:
        locks = environment.locks(self.addon)
        return Job([sys.executable, "-I", "-u", PROGRAM, str(folder), str(self.wheel), "--locks", str(locks), *options])


@pytest.fixture
def index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Index:
    return Index(tmp_path, monkeypatch)


def installed(folder: Path) -> set[str]:
    program = "import importlib.metadata as m; print(*(f'{d.name}=={d.version}' for d in m.distributions()))"
    said = subprocess.run([venv_python(folder), "-I", "-c", program], capture_output=True, text=True, check=True)
    return {line for line in said.stdout.split() if not line.startswith(("pip=", "setuptools="))}


@pytest.mark.parametrize("is_there", [True, False])
def test_what_reads_footage_is_installed_where_it_can_be_had(index: Index, tmp_path: Path, is_there: bool) -> None:
    """Without it, everything but Import Footage works."""
    video = index.put("tiny_video")
    (index.addon / "core" / environment.FOOTAGE).write_text(locked(video))
    if not is_there:
        video.unlink()
    state = index.job(tmp_path / "environment").wait(90)
    assert state.status == "done", list(state.log)
    assert installed(tmp_path / "environment") == LOCKED | ({"tiny-video==1.0"} if is_there else set())
    assert is_there != any(line.startswith("without footage: ") for line in state.log)


LOCKED = {"street-shapes==1.0", "torch==2.13.0", "nvidia-tiny==1.0", "unveil-core==0.1.0"}


def test_what_the_lock_lists_is_installed_and_nothing_else(index: Index, tmp_path: Path) -> None:
    index.put("street_shapes", "2.0")  # newer, and not in the lock
    folder = tmp_path / "environment"
    state = index.job(folder).wait(90)
    assert state.status == "done", list(state.log)
    assert installed(folder) == LOCKED


def test_torch_from_an_index_of_its_own_has_the_version_of_the_lock_and_another_s_unveil_is_refused(
    index: Index, tmp_path: Path
) -> None:
    tiny_wheel(index.wheel.parent, "import os\n")  # of the same name and version
    index.put("torch", "2.13.0", "build = 'cpu'\n")  # another build: another hash
    index.put("torch", "3.0")
    index.put("nvidia_tiny")
    state = index.job(tmp_path / "environment", "--torch-index", index.packages.as_uri()).wait(90)
    assert any("Successfully installed" in line and "torch-2.13.0" in line for line in state.log), list(state.log)
    assert state.status == "failed" and "\n" not in state.error
    assert "unveil-core is not the file that unveil was built with" in state.error
    assert not (tmp_path / "environment").exists()


def test_a_package_of_another_s_is_refused(index: Index, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same name and version, as a registry that was broken into would have it, or a folder of wheels."""
    index.put("street_shapes", text="import os\n")
    state = offline_job(index, tmp_path / "environment", monkeypatch).wait(90)
    assert state.status == "failed" and "\n" not in state.error
    assert "street_shapes==1.0 is not the file that unveil was built with" in state.error
    assert not (tmp_path / "environment").exists()


def offline_job(index: Index, folder: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> Job:
    """With pip's settings naming what it must not use: a folder that has everything, and an index that nobody answers at."""
    for name in ("PIP_NO_INDEX", "PIP_CONFIG_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    return index.job(folder, "--wheels", str(index.packages), "--torch-index", "http://127.0.0.1:9/simple", *options)


def test_a_wheel_that_is_missing_is_named_with_the_folder(
    index: Index, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though pip's own settings name a folder that has it. Nothing is asked of the index that they name."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    next(index.packages.glob("street_shapes-*")).rename(elsewhere / "street_shapes-1.0-py3-none-any.whl")
    monkeypatch.setenv("PIP_FIND_LINKS", str(elsewhere))
    state = offline_job(index, tmp_path / "environment", monkeypatch).wait(90)
    assert state.status == "failed" and "\n" not in state.error
    assert f"street_shapes==1.0 has no wheel in {index.packages} for Python 3." in state.error
    assert not any("127.0.0.1" in line for line in state.log if not line.startswith("$"))
    assert not (tmp_path / "environment").exists()


def test_a_folder_of_wheels_is_enough_and_may_have_a_local_build_of_torch(
    index: Index, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PIP_FIND_LINKS")
    index.put("torch", "2.13.0+cpu", requires=("street-shapes",))
    state = offline_job(index, tmp_path / "environment", monkeypatch).wait(90)
    assert state.status == "done", list(state.log)
    assert installed(tmp_path / "environment") == {
        "street-shapes==1.0",
        "torch==2.13.0+cpu",
        "unveil-core==0.1.0",
    }  # none of CUDA's
    assert not any("127.0.0.1" in line for line in state.log if not line.startswith("$"))


def test_the_folder_of_wheels_is_looked_at_before_anything_starts(tmp_path: Path) -> None:
    assert environment.wheels_folder(" ", "unveil") is None
    with pytest.raises(LookupError, match="Not a folder of wheels"):
        environment.wheels_folder(str(tmp_path / "none"), "unveil")
    with pytest.raises(LookupError, match="has no wheels"):
        environment.wheels_folder(str(tmp_path), "unveil")
    for name in ("numba-1-cp312-cp312-win_amd64.whl", "cv-1-cp37-abi3-win_amd64.whl", "plain-1-py3-none-any.whl"):
        (tmp_path / name).write_text("")
    assert environment.wheels_folder(str(tmp_path), "unveil") == tmp_path and environment.minors_of(tmp_path) == {12}
    with pytest.raises(LookupError, match="is an address"):
        environment.wheels_folder(str(tmp_path), "git+https://example.org/unveil")
