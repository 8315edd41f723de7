"""``push`` and ``watch`` without a service: which folders are stacks, the journal, the settings, completeness."""

from __future__ import annotations

import io
import json
import random
import re
from pathlib import Path, PureWindowsPath
from typing import Any, Dict, List

import pytest
from conftest import PROJECT

from pinstack import PinstackError
from pinstack.push import folders, settings, sheet
from pinstack.push.cli import main
from pinstack.push.journal import Journal, key_of
from pinstack.push.progress import Progress, duration
from pinstack.push.sender import Outcome
from pinstack.push.watch import Complete


def make(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    return root


def grouping(root: Path) -> Dict[str, List[List[str]]]:
    found = folders.find(root)
    return {s.name: [[path.name for path in s.front], [path.name for path in s.back]] for s in found.stacks}


def test_a_folder_per_light(tmp_path: Path) -> None:
    make(tmp_path, *(f"bee/{light}/img_{at}.jpg" for light in ("Front", "Gegenlicht") for at in (1, 2, 10)))
    slices = ["img_1.jpg", "img_2.jpg", "img_10.jpg"]
    assert grouping(tmp_path) == {"bee": [slices, slices]}


def test_the_searched_folder_may_be_the_stack_itself(tmp_path: Path) -> None:
    root = make(tmp_path / "bee 7", "front/1.jpg", "front/2.jpg", "back/1.jpg", "back/2.jpg")
    assert grouping(root) == {"bee_7": [["1.jpg", "2.jpg"], ["1.jpg", "2.jpg"]]}


def test_a_sibling_with_the_back_light(tmp_path: Path) -> None:
    make(tmp_path, "bee/1.jpg", "bee/2.jpg", "bee_back/1.jpg", "bee_back/2.jpg", "look_back/1.jpg", "look_back/2.jpg")
    two = ["1.jpg", "2.jpg"]
    assert grouping(tmp_path) == {"bee": [two, two], "look_back": [two, []]}


def test_the_order_has_signs(tmp_path: Path) -> None:
    make(tmp_path, *(f"v/_step_{at}_.jpg" for at in ("-08000", "00000", "-00500", "04000")), "v/_step_+0100_.jpg")
    (stack,) = folders.find(tmp_path).stacks
    steps = [re.findall(r"step_(.*)_", path.name)[0] for path in stack.front]
    assert steps == ["-08000", "-00500", "00000", "+0100", "04000"]


def test_what_belongs_to_no_stack_is_named(tmp_path: Path) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "v/1.cr2", "results/v.png", "notes.txt", "v/Thumbs.db", ".git/a.jpg")
    found = folders.find(tmp_path)
    assert {path.name: reason.split()[0] for path, reason in found.ignored} == {
        "1.cr2": "not",
        "v.png": "the",
        "notes.txt": "not",
    }
    assert [stack.name for stack in found.stacks] == ["v"]


def test_what_folders_do_not_tell_is_refused(tmp_path: Path) -> None:
    for light in ("with", "without"):
        make(tmp_path, *(f"tree/{light}_backlight/x=6/y=120/{at}.jpg" for at in (1, 2)))
    make(tmp_path, *(f"flat/view{view}_front_{at}.jpg" for view in (1, 2) for at in (1, 2)))
    make(tmp_path, *(f"twins/{at}.{kind}" for at in (1, 2) for kind in ("jpg", "tif")))
    make(tmp_path, *(f"good/IMG_{at}.jpg" for at in (1, 2)))
    problems = {stack.name: stack.problem for stack in folders.find(tmp_path).stacks}
    assert [name for name, problem in problems.items() if problem is None] == ["good"]
    assert all("one scan" in problem for problem in problems.values() if problem is not None)


def test_a_token_of_the_environment_wins_over_that_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("of the rig")
    file = tmp_path / "rig.toml"
    file.write_text(f'rig = "r"\nlens = "l"\ntoken_file = "{tmp_path}/token"\n')
    assert settings.load(file, {}, {}).token == "of the rig"
    assert settings.load(file, {}, {"PINSTACK_TOKEN": "t"}).token == "t"
    assert settings.load(file, {"token_file": tmp_path / "token"}, {"PINSTACK_TOKEN": "t"}).token == "of the rig"


def test_stacks_whose_names_meet_become_complete(tmp_path: Path) -> None:
    make(tmp_path, "a/b/1.jpg", "a/b/2.jpg", "a_b/1.jpg", "a_b/2.jpg")
    complete = Complete(0.0, lambda: 0.0)
    complete.of(folders.find(tmp_path).stacks)
    assert len(complete.of(folders.find(tmp_path).stacks)) == 2


def test_results_are_not_taken_for_stacks(tmp_path: Path) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "out/v.png", "out/contact-sheet/v.png", "w/out/1.jpg", "w/out/2.jpg")
    assert [stack.name for stack in folders.find(tmp_path, tmp_path / "out").stacks] == ["v", "w_out"]


def test_every_picture_is_in_exactly_one_place(tmp_path: Path) -> None:
    words = ["front", "back", "bee", "bee_back", "bee front", "x=6", "y=120", "masks", "View 01", "fond"]
    for seed in range(40):
        chance = random.Random(seed)
        root = tmp_path / str(seed)
        names = {"/".join([*chance.choices(words, k=chance.randrange(4)), f"img_{at}.jpg"]) for at in range(25)}
        make(root, *names)
        found = folders.find(root)
        placed = [path for stack in found.stacks for path in stack.files()] + [path for path, _ in found.ignored]
        assert sorted(placed) == sorted(root / name for name in names), seed


def test_the_words_for_lights_are_those_of_the_service() -> None:
    source = (PROJECT / "science/src/archive/light.rs").read_text("utf-8")
    results = (PROJECT / "science/src/archive/scan/folders.rs").read_text("utf-8")

    def words(text: str, name: str) -> set[str]:
        block = re.search(rf"const {name}: \[&str; \d+\] = \[(.*?)\];", text, re.DOTALL)
        assert block is not None, name
        return set(re.findall(r'"(\w+)"', block.group(1)))

    assert words(source, "FRONT") == folders.FRONT
    assert words(source, "BACK") == folders.BACK
    assert words(results, "RESULTS") | words(results, "TARGETS") == folders.NO_SLICES


@pytest.mark.parametrize(
    ("name", "pan", "tilt"),
    [
        ("pan020_tilt15", 20.0, 15.0),
        ("Bee_Tilt-06_Pan7.5", 7.5, -6.0),
        ("x=6_y=120", 120.0, 6.0),
        ("pan020p5_tilt0", 20.5, 0.0),
    ],
)
def test_angles_come_from_names(name: str, pan: float, tilt: float) -> None:
    assert folders.angles(name) == {"pan_deg": pan, "tilt_deg": tilt}


@pytest.mark.parametrize("name", ["bee", "pan1", "span3_tilt4", "pan1_pan2_tilt3"])
def test_names_without_both_angles_have_none(name: str) -> None:
    assert folders.angles(name) == {}


@pytest.mark.parametrize("name", ["con", "AUX.1", "a:b", "x?*", "..", "nul", "Bücher 3", "a/b", "trailing. "])
def test_result_names_are_allowed_on_windows(name: str) -> None:
    safe = folders.safe_name(name)
    assert safe and not PureWindowsPath(f"{safe}.png").is_reserved()
    assert PureWindowsPath("D:/results", safe).name == safe and not re.search(r'[<>:"/\\|?*]', safe)
    assert not safe.endswith((".", " "))


def test_a_journal_survives_and_is_used_by_one_process_at_a_time(tmp_path: Path) -> None:
    at = tmp_path / "deep/journal"
    journal = Journal(at)
    journal.note("k", "bee", upload="/v1/uploads/1")
    with pytest.raises(PinstackError, match="another push or watch"):
        Journal(at)
    journal.note("k", "bee", job="/v1/stacks/1")
    journal.close()
    again = Journal(at)
    entry = again.entry("k")
    assert (entry.upload, entry.job, entry.ended) == ("/v1/uploads/1", "/v1/stacks/1", None)
    again.forget("k")
    assert again.entry("k").upload is None
    again.close()
    at.write_bytes(b"no journal at all, but long enough to have a header" * 40)
    with pytest.raises(PinstackError, match="damaged"):
        Journal(at)


def test_another_service_rig_or_option_is_another_key() -> None:
    first = key_of("http://a", "rig", "lens", {"r1": 3}, "f")
    assert key_of("http://a/", "rig", "lens", {"r1": 3}, "f") == first
    others = [("http://b", "rig", "lens", {"r1": 3}), ("http://a", "rig2", "lens", {"r1": 3}),
              ("http://a", "rig", "lens", {"r1": 4})]  # fmt: skip
    assert all(key_of(*other, "f") != first for other in others)


def test_the_command_line_wins_over_the_environment_and_that_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("geheim\n")
    file = tmp_path / "rig.toml"
    file.write_text('server = "http://file"\nrig = "r"\nlens = "l"\njobs = 3\n[options]\nmethod = "guided"\nr1 = 2\n')
    given: Dict[str, Any] = {"rig": "other", "token_file": tmp_path / "token", "options": {"r1": 9}, "jobs": None}
    loaded = settings.load(file, given, {"PINSTACK_URL": "http://environment", "PINSTACK_TOKEN": "x"})
    assert (loaded.server, loaded.rig, loaded.lens, loaded.jobs) == ("http://environment", "other", "l", 3)
    assert loaded.options == {"method": "guided", "r1": 9}
    assert loaded.token == "geheim" and "geheim" not in repr(loaded)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('rig = "r"', "lens is missing"),
        ('rig = "r"\nlens = "l"\ncolour = 1', "no setting 'colour'"),
        ('rig = "r"\nlens = "l"\njobs = 99', "jobs is 99"),
        ('rig = "r"\nlens = "l"\njobs = "two"', "wrong type"),
        ('rig = "r"\nlens = "l"\nsave = ["photo"]', "no artifact 'photo'"),
        ("rig = ", "not valid TOML"),
    ],
)
def test_wrong_settings_are_named(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(text)
    with pytest.raises(PinstackError, match=re.escape(what)):
        settings.load(file, {}, {})


def test_options_are_numbers_where_they_look_like_numbers() -> None:
    assert settings.option("r1=30") == {"r1": 30}
    assert settings.option("mask_threshold=0.5") == {"mask_threshold": 0.5}
    assert settings.option("method=pyramid") == {"method": "pyramid"}
    with pytest.raises(PinstackError):
        settings.option("method")


def test_a_stack_is_complete_after_a_time_without_a_change(tmp_path: Path) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    now = [0.0]
    complete = Complete(20.0, lambda: now[0])

    def ready() -> List[str]:
        return [stack.name for stack in complete.of(folders.find(tmp_path).stacks)]

    assert ready() == []
    now[0] = 15.0
    make(tmp_path, "v/3.jpg")
    assert ready() == []
    now[0] = 30.0
    assert ready() == []
    now[0] = 35.0
    assert ready() == ["v"]


def test_a_file_that_another_program_holds_makes_a_stack_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    opened = Path.open
    held = [True]

    def open_unless_held(path: Path, *arguments: Any, **options: Any) -> Any:
        if held[0] and path.name == "2.jpg":
            # what Windows says of a sharing violation
            error = PermissionError(13, "The process cannot access the file", str(path))
            error.winerror = 32  # type: ignore[attr-defined]
            raise error
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", open_unless_held)
    complete = Complete(0.0, lambda: 0.0)
    assert complete.of(folders.find(tmp_path).stacks) == []
    held[0] = False
    assert [stack.name for stack in complete.of(folders.find(tmp_path).stacks)] == ["v"]


def test_a_dry_run_shows_the_grouping_and_needs_no_service(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path, "pan000_tilt15/front/1.jpg", "pan000_tilt15/front/2.jpg", "lonely/1.jpg", "readme.txt")
    assert main(["push", str(tmp_path), "--dry-run"]) == 1
    told = capsys.readouterr().out
    assert "pan000_tilt15: 2 front, 0 back, pan 0, tilt 15" in told
    assert "lonely: 1 front, 0 back  ! 1 front-light picture" in told and "readme.txt: not a JPEG" in told
    assert main(["push", str(tmp_path), "--dry-run", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert [stack["name"] for stack in document["stacks"]] == ["lonely", "pan000_tilt15"]


def test_wrong_usage_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["push", str(tmp_path / "nothing")]) == 2
    assert "is not a folder" in capsys.readouterr().err
    assert main(["push", str(tmp_path)]) == 2
    assert "rig is missing" in capsys.readouterr().err
    assert main(["push", str(tmp_path), "--rig", "r", "--lens", "l"]) == 2
    assert "no stack" in capsys.readouterr().err


def test_a_service_that_is_not_there_is_exit_code_3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    from pinstack import Client, Retry
    from pinstack.push import cli

    monkeypatch.setattr(cli, "_client", lambda settings: Client(settings.server, retry=Retry(attempts=1)))
    arguments = ["push", str(tmp_path), "--rig", "r", "--lens", "l", "--server", "http://127.0.0.1:9"]
    assert main(arguments) == 3


def test_without_a_terminal_every_event_is_a_line() -> None:
    out = io.StringIO()
    progress = Progress(2, out)
    for share in (0.0, 0.5, 1.0):
        progress.step("bee", "sending", share)
    progress.end(Outcome("bee", "refused", ["the profile has 9 slices"]))
    assert out.getvalue() == "bee: sending\nbee: refused: the profile has 9 slices\n"


@pytest.mark.parametrize(("seconds", "text"), [(45, "45 s"), (180, "3 min"), (7500, "2 h 05 min")])
def test_durations_are_short(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_contact_sheet_shows_every_stack_and_escapes_names(tmp_path: Path) -> None:
    make(tmp_path, "contact-sheet/bee.png")
    metrics = {"fusion": {"sharpness_retention": 0.953}, "alignment": {"residual_p95_px": 0.12}}
    good = Outcome("bee", "done", stack={"metrics": metrics})
    page = sheet.write([good, Outcome("<b>", "failed", ["a & b"])], tmp_path).read_text("utf-8")
    assert 'src="contact-sheet/bee.png"' in page and "sharpness 0.95, residual 0.12 px" in page
    assert "&lt;b&gt;" in page and "a &amp; b" in page and "<b><b>" not in page
