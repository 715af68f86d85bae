"""Round trip of a remote policy, without inference, beside two other policy servers.

Run: python -m benchmarks.versus_policy_servers [--rounds 10]

Makes the environment of the other two when it is missing (see requirements.txt). All processes stay
up; in every round each contestant in turn makes a block of round trips back to back and one at
10 Hz, in an order that turns with the rounds, so that a slow phase of the machine hits them all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from statistics import median

from benchmarks.environments import ensure_environment
from benchmarks.machine import describe_machine
from benchmarks.versus_policy_servers.contestants import (
    GRPC,
    LEGATO,
    WEBSOCKET,
    Client,
    make_contestants,
    started,
)
from common.statistics import quantile

ENVIRONMENT = ".venv-policy-servers"
REQUIREMENTS = Path(__file__).with_name("requirements.txt")
PERIOD_S = 0.1
ASKED = {WEBSOCKET: 1.3, GRPC: 0.2}
"""Largest share of their median that ours is to take."""
RULES = """\
observation  two images of 128 x 128 bytes, a step and a time; ours has its whole header, too
answer       steps of 7 numbers; no network, no inference. 16 steps: both of the others answer with
             a chunk. One step: what this project's own policies answer
measured     from the objects in the client to the objects in the client: encode, send, decode,
             validate where it is validated (ours: both ways), and back; 127.0.0.1
LEGATO       the real policy service, runner, bus, codec and messages; three processes: the router
             between the two others. The code has no way past the router
websocket    written by us in the form of openpi's server: asyncio server, synchronous client,
             msgpack with NumPy arrays; nothing is validated
gRPC         written by us in the form of LeRobot's: a pickle in a stream up, a queue, a pickled
             list of tensors that a thread of the client asks for; "asked after sending": no thread
"""

Rounds = Mapping[str, list[list[float]]]


def run_rounds(
    clients: Mapping[str, Client], *, rounds: int, count: int, period_s: float
) -> Rounds:
    """A block of every client per round; the order turns with the rounds."""
    measured: Rounds = {name: [] for name in clients}
    names = list(clients)
    for index in range(rounds):
        first = index % len(names)
        for name in (*names[first:], *names[:first]):
            measured[name].append(clients[name].measure(count=count, period_s=period_s))
    return measured


def print_table(title: str, measured: Rounds) -> None:
    """Median, p99 and what is asked, one row per contestant."""
    print(f"\n{title}")
    print(f"{'':28s}{'median us':>22s}{'p99 us':>9s}{'LEGATO takes':>22s}{'asked':>8s}")
    for name, blocks in measured.items():
        every = [time for block in blocks for time in block]
        medians = [median(block) for block in blocks]
        spread = f"{median(every):.0f} ({min(medians):.0f}-{max(medians):.0f})"
        row = f"{name:28s}{spread:>22s}{quantile(every, 0.99) or 0.0:9.0f}"
        if name != LEGATO:
            ratios = compute_ratios(measured, name)
            row += f"{f'{median(ratios):.2f} ({min(ratios):.2f}-{max(ratios):.2f})':>22s}"
            row += f"{describe_verdict(ratios, name):>12s}" if name in ASKED else ""
        print(row)


def compute_ratios(measured: Rounds, name: str) -> list[float]:
    """Our median over that of another one, round by round."""
    pairs = zip(measured[LEGATO], measured[name], strict=True)
    return [median(ours) / median(theirs) for ours, theirs in pairs]


def describe_verdict(ratios: list[float], name: str) -> str:
    """What is asked and whether it holds."""
    asked = ASKED[name]
    return f"<= {asked:g} " + ("met" if median(ratios) <= asked else "NOT met")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.versus_policy_servers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--steps", type=int, action="append", help="of an answer (16 and 1)")
    parser.add_argument("--count", type=int, default=300, help="back to back, per round")
    parser.add_argument("--paced", type=int, default=20, help="at 10 Hz, per round")
    args = parser.parse_args()

    python = ensure_environment(ENVIRONMENT, REQUIREMENTS, size="1.1 GB")
    print(describe_machine(("eclipse-zenoh", "pydantic", "ormsgpack", "msgpack", "numpy")))
    print(f"the others: {', '.join(REQUIREMENTS.read_text().split('# Asked')[0].split()[-7:])}")
    print(f"\n{RULES}")
    print(f"{args.rounds} rounds; in brackets the least and the largest median or ratio of a round")
    for steps in args.steps or (16, 1):
        measure(python, steps=steps, rounds=args.rounds, count=args.count, paced=args.paced)
    return 0


def measure(python: Path, *, steps: int, rounds: int, count: int, paced: int) -> None:
    """Print the tables of one length of answers."""
    with ExitStack() as stack:
        clients = {
            contestant.name: stack.enter_context(started(contestant))
            for contestant in make_contestants(python, steps=steps)
        }
        for client in clients.values():
            client.measure(count=count, period_s=0.0)
        answers = f"answers of {steps} step{'s' if steps > 1 else ''}"
        measured = run_rounds(clients, rounds=rounds, count=count, period_s=0.0)
        print_table(f"{answers}, back to back, {count} per round", measured)
        measured = run_rounds(clients, rounds=rounds, count=paced, period_s=PERIOD_S)
        print_table(f"{answers}, at 10 Hz, {paced} per round", measured)


if __name__ == "__main__":
    sys.exit(main())
