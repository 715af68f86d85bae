"""The `legato` command: finds the verb, parses its arguments, turns errors into exit codes."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import importlib
import io
import itertools
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import NoReturn

import tyro
from tyro.conf import FlagCreatePairsOff

from client import commands
from client.errors import WrongUse
from client.failures import exit_code_of, format_error
from client.interrupts import INTERRUPTED, install_interrupts, was_interrupted
from common import __version__
from common.errors import LegatoError, UnknownName

VERBS: dict[tuple[str, ...], tuple[type[commands.Command], str]] = {
    ("demo",): (commands.Demo, "demo:run"),
    ("demo", "record"): (commands.DemoRecord, "record:run"),
    ("train",): (commands.Train, "train:run"),
    ("up",): (commands.Up, "deploy:up"),
    ("down",): (commands.Down, "deploy:down"),
    ("status",): (commands.Status, "deploy:status"),
    ("stop",): (commands.Stop, "safety:stop"),
    ("reset",): (commands.Reset, "safety:reset"),
    ("eval",): (commands.Eval, "evaluate:run"),
    ("eval", "merge"): (commands.EvalMerge, "shards:merge"),
    ("report",): (commands.Report, "evaluate:write"),
    ("policy", "list"): (commands.PolicyList, "policy:show_all"),
    ("policy", "load"): (commands.PolicyLoad, "policy:load"),
    ("keys", "create"): (commands.KeysCreate, "keys:create"),
    ("keys", "list"): (commands.KeysList, "keys:show_all"),
    ("keys", "revoke"): (commands.KeysRevoke, "keys:revoke"),
    ("robot", "list"): (commands.RobotList, "robot:show_all"),
    ("robot", "check"): (commands.RobotCheck, "robot:check"),
    ("data", "view"): (commands.DataView, "data:view"),
    ("data", "check"): (commands.DataCheck, "data:check"),
    ("data", "export"): (commands.DataExport, "convert:write"),
    ("data", "import"): (commands.DataImport, "convert:read"),
    ("certs", "create"): (commands.CertsCreate, "certs:create"),
    ("certs", "add"): (commands.CertsAdd, "certs:add"),
    ("certs", "list"): (commands.CertsList, "certs:show_all"),
    ("certs", "revoke"): (commands.CertsRevoke, "certs:revoke"),
    ("topic", "list"): (commands.TopicList, "topic:list_topics"),
    ("topic", "echo"): (commands.TopicEcho, "topic:echo"),
    ("topic", "hz"): (commands.TopicHz, "topic:measure"),
}
"""Words of the verb -> its arguments, and where it is run: file and function in `client.verbs`."""

_WORDS = {
    r"invalid literal for int\(\) with base 10: (.*)": r"\1 is not a whole number",
    r"could not convert string to float: (.*)": r"\1 is not a number",
    r"Missing from [a-z ]+: ": "missing: ",
}
"""Python's and tyro's ways to say it -> ours."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `legato`: exits with 0 done, 1 could not run, 2 wrong use, 130 interrupted."""
    install_interrupts()
    try:
        code = run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except KeyboardInterrupt:
        code = INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe has seen enough, e.g. `legato topic echo ... | head`.
        os._exit(0)
    except Exception:
        if not was_interrupted():
            raise
        code = INTERRUPTED
    if code == INTERRUPTED:
        _leave(code)
    sys.exit(code)


def _leave(code: int) -> NoReturn:
    """Exit with this code and no other: everything is cleaned up.

    An interrupt that was caught inside `exec` of a text, while a module was imported say, makes
    CPython end itself with SIGINT whatever `sys.exit` is given; so does a second one while it
    shuts down.
    """
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    debug = "--debug" in arguments
    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            sys.stdout.write(format_help())
            return 0
        if arguments[0] == "--version":
            sys.stdout.write(f"legato {__version__}\n")
            return 0
        words, rest = find_verb(arguments)
        if words not in VERBS:
            sys.stdout.write(format_help(words))
            return 0
        kind, where = VERBS[words]
        command = parse(kind, rest, program=" ".join(("legato", *words)))
        module, function = where.split(":")
        verb = getattr(importlib.import_module(f"client.verbs.{module}"), function)
        return int(verb(command))
    except LegatoError as error:
        if debug:
            traceback.print_exc()
        sys.stderr.write(format_error(error) + "\n")
        return exit_code_of(error)


def find_verb(arguments: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
    """Split a command line into the words of the verb and the rest.

    A family without its second word, or with a request for help, gives the family's name alone.

    Raises:
        UnknownName: There is no such verb.
    """
    first, rest = arguments[0], list(arguments[1:])
    family = [words[1] for words in VERBS if words[0] == first and len(words) == 2]
    # A verb may be a family too: `legato demo` and `legato demo record`.
    if (first,) in VERBS and not (family and rest and not rest[0].startswith("-")):
        return (first,), rest
    if not family:
        raise UnknownName("command", first, list(dict.fromkeys(words[0] for words in VERBS)))
    if not rest or rest[0] in ("-h", "--help"):
        return (first,), rest
    if rest[0] not in family:
        raise UnknownName(f"command {first}", rest[0], family)
    return (first, rest[0]), rest[1:]


def parse(
    kind: type[commands.Command], arguments: Sequence[str], *, program: str
) -> commands.Command:
    """Arguments of one verb.

    Raises:
        WrongUse: An option that does not exist, or a value that is missing or of a wrong type.
    """
    _refuse_unknown_options(kind, arguments, program)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(kind, args=arguments, prog=program, config=(FlagCreatePairsOff,))
    except SystemExit as stop:
        if not stop.code:
            raise
        raise WrongUse(program, _extract_message(complaint.getvalue())) from None


def format_help(family: tuple[str, ...] = ()) -> str:
    """All verbs with the first line of their help, or those of one family."""
    shown = {words: kind for words, (kind, _) in VERBS.items() if words[: len(family)] == family}
    width = max(len(" ".join(words)) for words in shown)
    lines = [f"usage: legato {' '.join((*family, 'COMMAND'))} [OPTIONS]", ""]
    if not family:
        lines += ["Teach a skill once with one handheld gripper and run it on any robot.", ""]
    for words, kind in shown.items():
        summary = (kind.__doc__ or "").splitlines()[0]
        lines.append(f"  {' '.join(words):<{width}}  {summary}")
    lines += ["", "Options of a command: legato COMMAND --help. Version: legato --version."]
    return "\n".join(lines) + "\n"


def _refuse_unknown_options(
    kind: type[commands.Command], arguments: Sequence[str], program: str
) -> None:
    # `from_` is `--from`: Python keeps the word itself.
    names = [field.name.rstrip("_") for field in dataclasses.fields(kind)]
    known = ["--help", *("--" + name.replace("_", "-") for name in names)]
    given = [argument.split("=")[0] for argument in arguments if argument.startswith("--")]
    wrong = [option for option in given if option not in known]
    if not wrong:
        return
    close = [difflib.get_close_matches(option, known, n=1) for option in wrong]
    meant = ", ".join(match[0] for match in close if match)
    raise WrongUse(
        program,
        f"no option {', '.join(wrong)}",
        expected=f"did you mean: {meant}" if meant else None,
    )


def _extract_message(box: str) -> str:
    """The sentence in tyro's box: what stands between its title and the next rule."""
    rows = [line.strip("│╭╮╰╯ ") for line in box.splitlines()][1:]
    if rows and not rows[0].strip("─-"):
        # Without UTF-8 the title has a rule of its own.
        rows = rows[1:]
    body = itertools.takewhile(lambda row: row.strip("─-"), rows)
    message = " ".join(" ".join(body).split()).removeprefix("Error parsing ").rstrip(".:")
    for theirs, ours in _WORDS.items():
        message = re.sub(theirs, ours, message)
    return message or "the arguments are not understood"


if __name__ == "__main__":
    main()
