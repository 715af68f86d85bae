"""A policy server in the form of openpi's: msgpack with NumPy arrays over one websocket.

Written by us in that form: an asyncio server that decodes, acts and answers in one coroutine, a
client of the synchronous kind, no compression, no limit of size, a byte string of packed arrays
each way. Nothing is validated, as there. Runs in an environment of its own and imports nothing of
LEGATO but `blocks`.
"""

from __future__ import annotations

import argparse
import asyncio
import functools
import sys
import time
from typing import Any

import msgpack
import numpy as np
import websockets.asyncio.server
import websockets.exceptions
import websockets.sync.client

from benchmarks.versus_policy_servers.blocks import (
    ACTION_NUMBERS,
    IMAGE_PX,
    add_arguments,
    answer_orders,
    tell,
)


def pack_array(value: Any) -> Any:
    """An array as a map of its bytes, type and shape."""
    if isinstance(value, np.ndarray):
        return {
            b"array": True,
            b"data": value.tobytes(),
            b"dtype": value.dtype.str,
            b"shape": value.shape,
        }
    return value


def unpack_array(fields: dict[Any, Any]) -> Any:
    """The array of such a map."""
    if b"array" in fields:
        return np.ndarray(
            buffer=fields[b"data"], dtype=np.dtype(fields[b"dtype"]), shape=fields[b"shape"]
        )
    return fields


make_packer = functools.partial(msgpack.Packer, default=pack_array)
unpack = functools.partial(msgpack.unpackb, object_hook=unpack_array)


async def answer(connection: websockets.asyncio.server.ServerConnection, *, steps: int) -> None:
    """Answer every observation of one client."""
    packer = make_packer()
    await connection.send(packer.pack({}))
    try:
        while True:
            observation = unpack(await connection.recv())
            began_s = time.monotonic()
            action = {"actions": np.full((steps, ACTION_NUMBERS), 1e-3)}
            took_ms = 1e3 * (time.monotonic() - began_s)
            await connection.send(
                packer.pack({**action, "step": observation["step"], "infer_ms": took_ms})
            )
    except websockets.exceptions.ConnectionClosed:
        return


async def serve(port: int, *, steps: int) -> None:
    """Serve until killed."""
    async with websockets.asyncio.server.serve(
        functools.partial(answer, steps=steps), "127.0.0.1", port, compression=None, max_size=None
    ) as server:
        tell("ready")
        await server.serve_forever()


def ask(port: int, *, steps: int) -> None:
    """Be the client."""
    images = np.random.default_rng(0).integers(0, 256, (2, IMAGE_PX), dtype=np.uint8)
    left, right = (image.reshape(128, 128) for image in images)
    packer = make_packer()
    step = 0
    with websockets.sync.client.connect(
        f"ws://127.0.0.1:{port}", compression=None, max_size=None
    ) as connection:
        unpack(connection.recv())

        def round_trip() -> int:
            nonlocal step
            step += 10
            began_ns = time.perf_counter_ns()
            observation = {"step": step, "t_sim_s": 0.01 * step, "left": left, "right": right}
            connection.send(packer.pack(observation))
            reply = unpack(connection.recv())
            took_ns = time.perf_counter_ns() - began_ns
            if reply["step"] != step or reply["actions"].shape != (steps, ACTION_NUMBERS):
                raise SystemExit(f"wrong answer: {reply}")
            return took_ns

        answer_orders(round_trip)


def main() -> int:
    """Serve or ask."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=("serve", "ask"))
    add_arguments(parser)
    args = parser.parse_args()
    if args.role == "serve":
        asyncio.run(serve(args.port, steps=args.steps))
    else:
        ask(args.port, steps=args.steps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
