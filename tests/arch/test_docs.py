"""The documentation is true: links lead somewhere, code compiles, commands exist, programs run."""

from __future__ import annotations

import ast
import itertools
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
from support.pages import Block, Page, session_of
from support.terminals import Terminals

from simple_ros.cli.main import app
from simple_ros_master import Master
from simple_ros_master.cli import command as master_command

ROOT = Path(__file__).parents[2]
BUILT = ROOT / "docs" / "_build"
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted(path for path in ROOT.glob("docs/**/*.md") if BUILT not in path.parents),
    ROOT / "master" / "README.md",
]
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
WALKED = [
    name
    for name, path in zip(NAMES, PAGES, strict=True)
    if name.startswith(("docs/tutorial/", "docs/howto/", "docs/migration/"))
    and any(block.language == "console" for block in Page.read(path).blocks())
]


def page(name: str) -> Page:
    return Page.read(ROOT / name)


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    this = page(name)
    wrong = []
    for number, target in this.links():
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        path = (this.path.parent / file).resolve() if file else this.path
        if not path.exists() or (anchor and anchor not in Page.read(path).anchors()):
            wrong.append(f"{name}:{number}: {target}")
    assert wrong == []


@pytest.mark.parametrize("name", NAMES)
def test_python_compiles(name: str) -> None:
    for block in page(name).blocks():
        if block.language == "python":
            padded = "\n" * block.line + block.text
            compile(padded, name, "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT, dont_inherit=True)


def shown_commands(block: Block) -> list[str]:
    if block.language == "console":
        return [command.text for command in session_of(block).commands]
    if block.language in ("sh", "bash"):
        return block.text.splitlines()
    return []


@pytest.mark.parametrize("name", NAMES)
def test_commands_exist(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every `simple-ros` that is shown has that command, these arguments and these options."""
    monkeypatch.chdir(tmp_path)
    for block in page(name).blocks():
        for shown in shown_commands(block):
            for words in simple_ros_calls(shown):
                for file in (word for word in words if word.endswith(".proto")):
                    (tmp_path / file).touch()
                check_call(words)


def simple_ros_calls(shown: str) -> list[list[str]]:
    """The calls of our commands in a line of shell, each as words without its redirections."""
    words = shlex.split(shown, comments=True)
    calls: list[list[str]] = []
    for index, word in enumerate(words):
        if word in ("simple-ros", "simple-ros-master"):
            rest = words[index:]
            end = next((i for i, w in enumerate(rest) if w in ("|", "&", "&&", ";", ">")), None)
            calls.append(rest[:end])
    return calls


def check_call(words: list[str]) -> None:
    command, context, arguments = found(words)
    # Help would print and exit; a command that is only named need not be complete.
    named = not arguments or not {"-h", "--help"}.isdisjoint(arguments)
    context.resilient_parsing = named
    command.parse_args(context, arguments)


def found(words: list[str]) -> tuple[Any, Any, list[str]]:
    """The command that words call, its context, and its arguments."""
    if words[0] == "simple-ros-master":
        master = typer.Typer(add_completion=False)
        master.command()(master_command)
        command: Any = typer.main.get_command(master)
    else:
        command = typer.main.get_command(app)
    context = command.context_class(command, info_name=words[0])
    rest = words[1:]
    while rest and hasattr(command, "get_command") and not rest[0].startswith("-"):
        name, *rest = rest
        command = command.get_command(context, name)
        assert command is not None, f"there is no command {name!r} in {shlex.join(words)!r}"
        context = command.context_class(command, info_name=name, parent=context)
    return command, context, rest


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_sentences_exist(name: str) -> None:
    """Also those that are only named, as in `simple-ros msg list | show`; capitals stand for something."""
    for _, line in page(name).prose():
        for code in re.findall(r"`(simple-ros [^`]+)`", line):
            words = re.sub(r" *\| *", "|", code).split()
            known = list(itertools.takewhile(lambda word: re.fullmatch(r"[a-z|-]+", word), words))
            for choice in itertools.product(*(word.split("|") for word in known)):
                found(list(choice))


def pages_before(name: str) -> list[str]:
    """The steps of the tutorial that come before this one: their files are still there."""
    folder = Path(name).parent
    if folder.name != "tutorial":
        return []
    steps = [str(folder / target) for _, target in page(str(folder / "index.md")).links()]
    return steps[: steps.index(name)]


def write_files(source: Page, directory: Path) -> None:
    for block in source.blocks():
        if block.file_name:
            write_file(block, directory)


def write_file(block: Block, directory: Path) -> None:
    (directory / block.file_name).write_text(block.text + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", WALKED)
async def test_the_page_works(name: str, master: Master, tmp_path: Path) -> None:
    """Its files are written and its commands run from top to bottom, and print what it shows.

    Numbers may differ. What is still running at the end is ended with Ctrl-C.
    """
    terminals = Terminals(tmp_path, master)
    for earlier in pages_before(name):
        write_files(page(earlier), tmp_path)
    try:
        for block in page(name).blocks():
            if block.file_name:
                write_file(block, tmp_path)
            elif block.language == "console":
                await terminals.run(block)
        await terminals.leave_all()
    finally:
        await terminals.kill_all()


def test_every_program_of_a_walked_page_is_run() -> None:
    for name in WALKED:
        blocks = page(name).blocks()
        typed = "\n".join("\n".join(shown_commands(block)) for block in blocks)
        for block in blocks:
            stem = block.file_name.rpartition(".")[0]
            used = f"{stem}_pb2" in page(name).text or block.file_name in typed
            assert not stem or used, f"{name}:{block.line}: nobody runs {block.file_name}"
