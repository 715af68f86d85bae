"""`legato eval` and `legato report`."""

from __future__ import annotations

import dataclasses
import json
import os
import shlex
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from client.api import LegatoClient
from client.commands import Eval, EvalMerge, Report
from client.errors import WrongUse
from client.interrupts import INTERRUPTED, postpone_interrupts
from client.progress import open_progress
from client.record import EvaluationRecord, load_record, to_json
from client.report import write_report
from client.request import build_request, check_request
from client.tables import format_results
from common.api import EvaluationRequest
from common.errors import InvalidValue

CANCEL_S = 3.0


def run(command: Eval) -> int:
    """Evaluate, show the results, and tell whether it was interrupted."""
    if uses_shards(command):
        # Here, because only few evaluations need it.
        from client.verbs.shards import run_shards

        return run_shards(command)
    command, checkpoints = name_folders(command)
    request = build_request(command, pictures=command.report is not None or not command.in_process)
    if command.in_process:
        record, interrupted = _run_here(request, checkpoints)
        conclude(command, record)
    else:
        with LegatoClient(command.url) as client:
            record, interrupted = run_over_rest(client, request)
            conclude(command, record)
    return INTERRUPTED if interrupted else 0


def uses_shards(command: Eval) -> bool:
    """Whether an evaluation is to be run in parts, with options that go together.

    Raises:
        WrongUse: Options that contradict each other, or would do nothing.
    """
    program = "legato eval"
    in_shards = command.shard is not None or command.workers is not None
    if command.shard is not None and command.workers is not None:
        raise WrongUse(program, "--shard and --workers are given", expected="one of them")
    if in_shards and command.out is None:
        given = "--shard" if command.workers is None else "--workers"
        raise WrongUse(program, f"{given} without --out", expected="the folder of the shards")
    if command.ray and command.workers is None:
        raise WrongUse(program, "--ray without --workers", expected="the number of shards")
    if command.out is not None and not in_shards:
        raise WrongUse(program, "--out without --shard or --workers", expected="one of them")
    if command.shard is not None and (command.json or command.report is not None):
        expected = "--json and --report with: legato eval merge"
        raise WrongUse(program, "a shard has no results of its own", expected=expected)
    if command.pictures and command.shard is None:
        expected = "--report alone, which keeps pictures"
        raise WrongUse(program, "--pictures without --shard", expected=expected)
    return in_shards


def name_folders(command: Eval) -> tuple[Eval, dict[str, Path]]:
    """Give policies that are folders of checkpoints the names of these folders.

    Returns:
        The command with names only, and the folders by name.

    Raises:
        InvalidValue: A folder for services, which have names only, or two folders of one name.
    """
    folders: dict[str, Path] = {}
    names: list[str] = []
    for given in command.policy:
        if os.sep in given:
            if not (command.in_process or command.out is not None):
                known = "a name; first run: legato policy load NAME FOLDER"
                raise InvalidValue("--policy", given, known)
            folder = Path(given).absolute()
            if folder.name in folders:
                raise InvalidValue("--policy", given, "folders with different names")
            folders[folder.name] = folder
            names.append(folder.name)
        else:
            names.append(given)
    return dataclasses.replace(command, policy=tuple(names)), folders


def write(command: Report) -> int:
    """Write the report of an evaluation that the control plane keeps."""
    with LegatoClient(command.url) as client:
        record = load_record(client, command.evaluation)
        write_report(record, command.out, command=command_line())
    sys.stdout.write(f"{command.out}\n")
    return 0


def run_over_rest(
    client: LegatoClient, request: EvaluationRequest
) -> tuple[EvaluationRecord, bool]:
    """Evaluate on a control plane with progress on standard error.

    Returns:
        What came out, and whether Ctrl-C cancelled it.
    """
    check_request(client, request)
    identifier = client.submit(request).id
    interrupted = False
    try:
        with open_progress() as progress:
            for event in client.events(identifier):
                progress.update(event)
    except KeyboardInterrupt:
        interrupted = True
        _cancel(client, identifier)
    return load_record(client, identifier), interrupted


def _cancel(client: LegatoClient, identifier: str) -> None:
    """Stop an evaluation and give the control plane a moment to close its open trials."""
    client.cancel(identifier)
    deadline_s = time.monotonic() + CANCEL_S
    while client.evaluation(identifier).status == "running" and time.monotonic() < deadline_s:
        time.sleep(0.05)


def _run_here(
    request: EvaluationRequest, checkpoints: Mapping[str, Path]
) -> tuple[EvaluationRecord, bool]:
    # Here, because it imports the physics engine and the solvers.
    from client.offline import run_in_process

    stop = threading.Event()
    with postpone_interrupts(stop), open_progress() as progress:
        record = run_in_process(request, progress=progress, stop=stop, checkpoints=checkpoints)
    return record, stop.is_set()


def conclude(command: Eval | EvalMerge, record: EvaluationRecord) -> None:
    """Show the results as the options say."""
    if command.json:
        sys.stdout.write(json.dumps(to_json(record)) + "\n")
    else:
        sys.stdout.write(format_results(record.evaluation) + "\n")
    if command.report is not None:
        write_report(record, command.report, command=command_line())
        _tell(command.report)


def _tell(path: Path) -> None:
    sys.stderr.write(f"report: {path}\n")


def command_line() -> str:
    """This command as it was typed, for the record."""
    return shlex.join(["legato", *sys.argv[1:]])
