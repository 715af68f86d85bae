"""Draw the pictures of the README: python -m docs.make_pictures."""

from __future__ import annotations

import io
import threading
from pathlib import Path

from PIL import Image

from client.offline import run_in_process
from client.progress import LineProgress
from client.record import EvaluationRecord
from common.api import EvaluationRequest

FOLDER = Path(__file__).parent / "pictures"
ROBOTS = ("abstract", "panda")
MOMENTS = ("start", "grasp", "release")
EDGE_PX = 6


def main() -> None:
    """One episode per robot: a row of scene views, and what the left eye sees below each."""
    request = EvaluationRequest(tasks=["lid"], robots=list(ROBOTS), policy="expert", trials=1)
    record = run_in_process(request, progress=LineProgress(io.StringIO()), stop=threading.Event())
    rows = [draw_row(record, robot) for robot in ROBOTS]
    width, height = rows[0].size
    sheet = Image.new("RGB", (width, len(rows) * (height + EDGE_PX) - EDGE_PX), "white")
    for number, row in enumerate(rows):
        sheet.paste(row, (0, number * (height + EDGE_PX)))
    FOLDER.mkdir(exist_ok=True)
    sheet.save(FOLDER / "lid.png", optimize=True)


def draw_row(record: EvaluationRecord, robot: str) -> Image.Image:
    """Scene views of one robot's trial with the left eye's picture in the corner."""
    (trial,) = (trial for trial in record.trials if trial.robot == robot)
    scenes: list[Image.Image] = []
    for moment in MOMENTS:
        scene = Image.open(io.BytesIO(record.picture(trial, f"{moment}-scene"))).convert("RGB")
        eye = Image.open(io.BytesIO(record.picture(trial, f"{moment}-left"))).convert("RGB")
        scene.paste(eye, (scene.width - eye.width, 0))
        scenes.append(scene)
    width, height = scenes[0].size
    row = Image.new("RGB", (len(scenes) * (width + EDGE_PX) - EDGE_PX, height), "white")
    for number, scene in enumerate(scenes):
        row.paste(scene, (number * (width + EDGE_PX), 0))
    return row


if __name__ == "__main__":
    main()
