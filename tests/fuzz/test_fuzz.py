"""Every reader on some hostile files: what it does not take, it refuses in one clear line.

``benchmarks/robustness/fuzz.py`` tries more.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.mutate import mutator_of
from tests.fuzz.reader import Opened, Reader, Wrong
from tests.fuzz.run import fuzz, input_of
from tests.fuzz.shrink import shrunk
from tests.fuzz.table import READERS
from tests.fuzz.verdict import Finding, judged
from unveil_core.base.checks.fields import checked
from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import UnveilError
from unveil_core.base.files import parsed_json
from unveil_core.farm.state import TaskState
from unveil_core.pipeline.settings import RunSettings

INPUTS = {"text": 80, "binary": 60}
SINGLE = [reader for reader in READERS.values() if reader.kind in INPUTS]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


REFUSED = ("animated PNG", "JPEG 2000")


@pytest.mark.filterwarnings("ignore::RuntimeWarning", "ignore::UserWarning")
@pytest.mark.parametrize("reader", SINGLE, ids=lambda r: r.name)
def test_hostile_files_are_read_or_refused(reader: Reader, tmp_path: Path) -> None:
    opened = reader.prepare(tmp_path / "files")
    originals = [file.read_bytes() for file in opened.files]
    taken = [judged(reader, opened, file) for file in opened.files]
    # Beside a still picture lie those of formats that are never decoded.
    assert taken == ([True] + [False] * (len(taken) - 1) if reader.name in REFUSED else [True] * len(taken))
    mutators = [mutator_of(content) for content in originals]
    for index in range(INPUTS[reader.kind]):
        k, content = input_of(reader, mutators, 1, index)
        opened.files[k].write_bytes(content)
        found = judged(reader, opened, opened.files[k])
        assert isinstance(found, bool), f"input {index}, {opened.files[k].name}: {found}\n{content[:300]!r}"
        opened.files[k].write_bytes(originals[k])


def test_equal_seeds_give_equal_inputs(tmp_path: Path) -> None:
    reader = READERS["cameras.json"]
    mutators = [mutator_of(f.read_bytes()) for f in reader.prepare(tmp_path / "files").files]
    some = [[input_of(reader, mutators, seed, i) for i in range(40)] for seed in (3, 3, 4)]
    assert some[0] == some[1] != some[2]
    assert len({content for _, content in some[0]}) > 30


def _faulty(folder: Path) -> Opened:
    """A reader that goes wrong in every way, by the first letter of its file."""
    folder.mkdir()
    path = folder / "a.txt"
    path.write_bytes(b"fine, " * 20)

    def read(file: Path) -> None:
        match file.read_bytes()[:1]:
            case b"f":
                return
            case b"0" | b"n" | b"1" | b"9":
                raise KeyError("not foreseen")
            case b"/" | b"<":
                os.kill(os.getpid(), signal.SIGKILL)
            case b"." | b"-":
                time.sleep(60)
            case b"":
                raise Wrong("an empty file is taken")
            case b"i" | b"2" | b"c":
                raise MemoryError
        raise UnveilError("is refused", path=file)

    return Opened((path,), read)


def test_what_goes_wrong_is_counted_and_made_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("tests.fuzz.run", fromlist=["HANG_S"]).HANG_S, "text", 0.3)
    said: list[str] = []
    tally = fuzz(Reader("faulty", "text", _faulty), 250, seed=2, findings=tmp_path / "found", say=said.append)
    assert tally.tried == 250 and 0 < tally.read < 250
    assert all(tally.counts.values()), tally.counts
    texts = {p.read_bytes() for p in (tmp_path / "found").rglob("a.txt")}
    assert {b"0", b"n", b"1", b"9"} & texts  # of a KeyError one letter is left
    assert any("died of signal 9" in line for line in said) and any("KeyError" in line for line in said)


def test_an_input_shrinks_to_what_it_needs() -> None:
    assert shrunk(b"some words and !! some more", lambda content: content.count(b"!") == 2) == b"!!"


@given(st.text(st.characters(codec=None)), st.text(st.characters(codec=None)), st.none() | st.text())
@settings(max_examples=100, deadline=None)
def test_errors_are_one_line_that_a_terminal_can_show(problem: str, path: str, mend: str | None) -> None:
    line = str(UnveilError(problem * 50, path=path, mend=mend))
    assert line.isprintable() and len(line) < 2500


@given(JSON)
@settings(max_examples=100, deadline=None)
def test_settings_and_states_of_strangers_are_checked(content: object) -> None:
    for kind in (RunSettings, TaskState):
        try:
            found = checked(kind, content)
        except (TypeError, ValueError, UnveilError):
            continue
        assert isinstance(found, kind)


@given(st.text(st.characters(codec=None), max_size=300))
@settings(max_examples=100, deadline=None)
def test_names_of_files_are_such_or_refused(name: str) -> None:
    try:
        path = named_path(Path("/nowhere"), name, Path("drive.json"), "file_path")
    except UnveilError as error:
        assert "drive.json: Not the name of a file: file_path" in str(error)
    else:
        assert not path.is_dir() or name in ("/", ".", "..") or path.exists()


def test_long_numbers_become_floats_and_deep_lists_an_error() -> None:
    assert parsed_json("[9007199254740993, 1" + "0" * 400 + "]") == [9007199254740993, float("inf")]
    with pytest.raises(ValueError, match="too many lists"):
        parsed_json("[" * 100_000)


def test_findings_of_one_place_are_one() -> None:
    reader = Reader("faulty", "text", _faulty)

    def read(_: Path) -> None:
        raise ZeroDivisionError

    first, second = (judged(reader, Opened((), read), Path("x")) for _ in range(2))
    assert isinstance(first, Finding) and isinstance(second, Finding)
    assert first.where == second.where and first.kind == "crash" and "ZeroDivisionError" in first.trace
