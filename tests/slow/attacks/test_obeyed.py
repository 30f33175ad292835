"""What a stranger sent is read, not obeyed: whole programs in the folders of strangers.

    python -m pytest tests/slow/attacks

Each test is an attack that once worked. Quick tests of the same parts lie in ``tests/``.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import unicodedata
from pathlib import Path

import pytest

from tests.drives.formats.test_kitti_raw import pose_item, tracklets, write_drive, write_text
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.app.cli import main

ORDERS = "\x1b]52;c;cm0gLXJmIH4=\x07\x1b[2J\u202e"
"""Sets the clipboard, clears the screen, turns the direction of writing."""
COMMAND = "import sys; sys.argv[1:] = ['--version']; from unveil_core.app.cli import main; main()"
"""What the script ``unveil`` does; what comes after it in a program happens in the command's process."""
STRANGER = "raise SystemExit('imported from the folder of a stranger')"


def unveil(
    folder: Path, *arguments: str, python: tuple[str, ...] = ("-m", "unveil_core")
) -> subprocess.CompletedProcess[str]:
    """The command, as somebody runs it in a folder."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONSAFEPATH", "LD_LIBRARY_PATH")}
    command = [sys.executable, *python, *arguments]
    return subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, timeout=300)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """The folder of a small drive."""
    return make_tiny_drive(tmp_path / "drive").parent


def test_settings_of_numba_beside_a_drive(drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    (drive / ".numba_config.yaml").write_text("chrome_trace: ../trace\ncache_dir: .cache\ndebug: 1\ndump_bytecode: 1\n")
    done = unveil(drive, "import", ".", "-o", "../ws")
    assert done.returncode == 0, done.stderr
    # The rest of a run compiles kernels; here one does.
    kernel = "f = njit(lambda x: x + 1); assert f(1) == 2 and f.signatures"
    kernel = f"from unveil_core.base.kernels.compiled import njit; {kernel}"
    done = unveil(drive, python=("-c", f"{COMMAND}; import unveil_core.raster.cpu.forward; {kernel}"))
    assert done.returncode == 0 and done.stdout.count("\n") == 1, done.stdout + done.stderr
    assert not (tmp_path / "trace").exists() and not (drive / ".cache").exists()


def test_modules_beside_a_drive(drive: Path) -> None:
    for name in ("numpy", "torch", "typing", "json", "cv2"):
        (drive / f"{name}.py").write_text(STRANGER)
    done = unveil(drive, "import", ".", "-o", "../ws")
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the loader of Linux")
def test_libraries_beside_a_drive(drive: Path) -> None:
    for name in ("libc.so.6", "libm.so.6", "libpthread.so.0"):
        (drive / name).write_bytes(b"no library")
    program = f"{COMMAND}; import cv2, subprocess; print(subprocess.run(['/bin/ls'], capture_output=True, text=True))"
    done = unveil(drive, python=("-c", program))
    assert "returncode=0" in done.stdout and "libc.so.6: " not in done.stdout, done.stdout + done.stderr


def test_tracklets_as_they_are_released_and_with_entities(tmp_path: Path) -> None:
    folder = write_drive(tmp_path)
    write_text(folder / "tracklet_labels.xml", tracklets(pose_item(10, 0.3)))
    assert "<!DOCTYPE boost_serialization>" in (folder / "tracklet_labels.xml").read_text()
    assert main(["import", str(folder), "-o", str(tmp_path / "ws")]) == 0
    assert json.loads((tmp_path / "ws/objects.json").read_text())
    bomb = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;">]>'
    write_text(folder / "tracklet_labels.xml", tracklets("<item>&c;</item>", extra=bomb))
    assert main(["import", str(folder), "-o", str(tmp_path / "ws2")]) == 2
    assert not (tmp_path / "ws2").exists()


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_nobody_else_runs_code_in_a_batch(drive: Path, tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil")
    pytest.importorskip("distributed")
    assert main(["batch", "plan", str(drive), "-o", str(tmp_path / "batch"), "--quality", "draft"]) == 0
    command = [sys.executable, "-P", "-m", "unveil_core", "batch", "run", str(tmp_path / "batch"), "--workers", "2"]
    with (tmp_path / "said").open("wb") as said:
        process = subprocess.Popen(command, stdout=said, stderr=said, stdin=subprocess.DEVNULL, start_new_session=True)
    try:
        end = time.monotonic() + 300
        while b"begun" not in (tmp_path / "said").read_bytes() and time.monotonic() < end and process.poll() is None:
            time.sleep(0.1)
        assert b"begun" in (tmp_path / "said").read_bytes()
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        listening = [c.laddr for p in family for c in p.net_connections("tcp") if c.status == "LISTEN"]
        assert {address.ip for address in listening} <= {"127.0.0.1", "::1"}
        for address in listening:  # pages to look at, and nothing that takes orders
            with socket.create_connection((address.ip, address.port), timeout=10) as connection:
                connection.sendall(b"GET /health HTTP/1.0\r\n\r\n")
                assert connection.recv(5) == b"HTTP/"
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 130
    assert not [p for p in family if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


def test_a_truth_that_is_somebody_s_home(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from unveil_core.pipeline.outside import files_of_truth
    from unveil_core.pipeline.settings import RunSettings
    from unveil_core.pipeline.up_to_date import Digests
    from unveil_core.workspace.workspace import Workspace

    home = tmp_path / "home/alice"
    (home / "taxes").mkdir(parents=True)
    (home / "taxes/2025.txt").write_text("salary 1234")
    (home / "id_rsa").write_text("key")
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    edit(tmp_path / "ws/drive/cameras.json", lambda d: d.update(truth_root=str(home)))
    workspace = Workspace.open(tmp_path / "ws")
    digests = Digests(workspace)
    digests.of_outside(files_of_truth(workspace, RunSettings(), drive))
    digests.save()
    kept = [p.read_text() for p in (tmp_path / "ws/.digests.json", *(tmp_path / "cache").rglob("*.json"))]
    assert not any("2025.txt" in text or "id_rsa" in text for text in kept) and str(tmp_path) not in kept[0]


def test_orders_to_a_terminal_in_names(drive: Path, tmp_path: Path) -> None:
    folder = drive.rename(tmp_path / f"drive {ORDERS}")
    edit(folder / "transforms.json", lambda d: d["frames"][1].update(semantic_path=f"semantics/{ORDERS}.png"))
    seen = [
        unveil(tmp_path, "import", str(folder), "-o", "ws"),
        unveil(tmp_path, "run", f"{folder}{ORDERS}", "-o", "ws2"),
    ]
    make_tiny_drive(tmp_path / "other")
    seen.append(unveil(tmp_path, "batch", "plan", "other", str(folder), "-o", "batch"))
    task = json.loads((tmp_path / "batch/batch.json").read_text())["tasks"][0]
    state = {
        "status": "failed",
        "tries": 3,
        "seconds": 1.0,
        "line": f"{ORDERS}\nall is well",
        "host": "x",
        "process": 1,
    }
    (tmp_path / "batch/tasks").mkdir(exist_ok=True)
    (tmp_path / f"batch/tasks/{task['id']}.json").write_text(json.dumps({**state, "arguments": task["arguments"]}))
    seen.append(unveil(tmp_path, "batch", "status", "batch"))
    assert "all is well" in seen[-1].stdout and "\nall is well" not in seen[-1].stdout
    said = "".join(done.stdout + done.stderr for done in seen)
    assert "\\x1b" in said and not any(c in said for c in "\x1b\x07\u202e")


def test_names_that_other_systems_take_for_one_or_for_a_device(drive: Path, tmp_path: Path) -> None:
    names = ["caf\u00e9", "cafe\u0301", "COM\u00b9", "conin$"]

    def rename(document: dict) -> None:  # type: ignore[type-arg]
        for i, (entry, name) in enumerate(zip(document["frames"], names, strict=True)):
            (drive / f"images/{i:02d}.png").rename(drive / f"images/{name}.png")
            entry["file_path"] = f"images/{name}.png"

    edit(drive / "transforms.json", rename)
    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    found = [f["name"] for f in json.loads((tmp_path / "ws/drive/cameras.json").read_text())["frames"]]
    assert len({unicodedata.normalize("NFC", name).casefold() for name in found}) == 4
    assert found[2:] == ["_COM\u00b9", "_conin$"]


def test_the_page_that_is_sent_to_others(tmp_path: Path) -> None:
    from unveil_core.report.page import write_report

    home = tmp_path / "home/alice.secret/clients"
    drive = make_tiny_drive(home / "street")
    assert main(["import", str(drive), "-o", str(home / "ws")]) == 0
    write_report(home / "ws", tmp_path / "page")
    page = (tmp_path / "page/index.html").read_text()
    assert "alice.secret" not in page
    assert "unveil run street/transforms.json" in page.replace("<span>", "").replace("</span>", "")


def test_a_password_in_the_address_of_an_index() -> None:
    from blender_addon.worker.jobs import Job

    address = "https://alice:secret@wheels.example.org/simple"
    job = Job(
        [sys.executable, "-c", f"print('Looking in indexes: {address}'); raise SystemExit('no {address}')", address]
    )
    state = job.wait(30)
    text = "\n".join(state.log)
    assert "wheels.example.org" in text and "secret" not in text and "alice" not in text


def test_time_stamps_of_no_clock(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from blender_addon.formats.drive_files import read_drive

    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    for spoilt in ({"frame_rate": 1e308}, {"frame_rate": 10.0, "frames.timestamp": 1e300}):
        edit(
            tmp_path / "ws/drive/cameras.json",
            lambda d, s=spoilt: (  # type: ignore[misc]
                d.update(frame_rate=s["frame_rate"]),
                [f.update(timestamp=i * s.get("frames.timestamp", 0.1)) for i, f in enumerate(d["frames"])],
            ),
        )
        capsys.readouterr()
        with pytest.raises(ValueError, match="Not an imported drive"):
            read_drive(tmp_path / "ws")
        assert main(["export", str(tmp_path / "ws"), "--to", "chan", "-o", str(tmp_path / "out")]) == 2
        assert capsys.readouterr().err.count("\n") == 1
