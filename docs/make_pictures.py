"""Draw the pictures of the README and the docs: python -m docs.make_pictures.

With `--meshes FOLDER` robots are drawn with the meshes of that copy of MuJoCo Menagerie, as far as
it has them; `--out FOLDER` keeps these pictures apart.
"""

from __future__ import annotations

import argparse
import io
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from client.offline import run_in_process
from client.progress import LineProgress
from client.record import EvaluationRecord
from common.api import EvaluationRequest
from common.calibration import load_calibration
from common.robots import list_robots, load_robot
from common.robots.menagerie import find_menagerie
from common.tasks import load_task
from common.tasks.recording import load_recording
from common.tasks.task import SceneCamera
from examples.retarget_recorded import follow
from examples.retarget_sheet import draw_sheet
from services.retarget.robot_model import RobotModel
from services.sim.camera import SceneRenderer, StereoCamera
from services.sim.dress import dress
from services.sim.world import TOOL_SITE, World

FOLDER = Path(__file__).parent / "pictures"
EDGE_PX = 6
WHITE, INK = (255, 255, 255), (40, 40, 40)

LID_ROBOTS = ("abstract", "panda")
MOMENTS = ("start", "grasp", "release")

TASKS = ("lid", "cup", "ladle")
SCENE_PX = (256, 192)
PORTRAIT_PX = (236, 300)
CAPTION_PX = 24
PORTRAIT = SceneCamera(position_m=(1.62, -1.62, 1.56), target_m=(0.13, -0.08, 0.81), fovy_deg=45.0)
"""From where the task is seen as well, but further back: whole robots."""

RETARGETED = "gr1"
"""The robot with the most joints, and with a head."""


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", type=Path, default=find_menagerie())
    parser.add_argument("--out", type=Path, default=FOLDER)
    args = parser.parse_args()
    out, studio = args.out, Studio(args.meshes)
    out.mkdir(exist_ok=True)
    draw_lid().save(out / "lid.png", optimize=True)
    join([studio.draw_portrait(robot) for robot in list_robots()]).save(
        out / "robots.png", optimize=True
    )
    draw_worlds(studio.draw_scene).save(out / "worlds.png", optimize=True)
    draw_worlds(draw_eyes).save(out / "eyes.png", optimize=True)
    recording, obstacles = load_recording("lid"), load_task("lid").obstacles
    run = follow(RobotModel(load_robot(RETARGETED)), recording, obstacles)
    sheet = draw_sheet(run, title=f"{run.model.spec.title} · {recording.task}")
    sheet.savefig(out / "retarget.png", pil_kwargs={"optimize": True})


def draw_lid() -> Image.Image:
    """One episode per robot: a row of scene views, and what the left eye sees in each."""
    request = EvaluationRequest(tasks=["lid"], robots=list(LID_ROBOTS), policy="expert", trials=1)
    record = run_in_process(request, progress=LineProgress(io.StringIO()), stop=threading.Event())
    return stack([draw_row(record, robot) for robot in LID_ROBOTS])


def draw_row(record: EvaluationRecord, robot: str) -> Image.Image:
    """Scene views of one robot's trial with the left eye's picture in the corner."""
    (trial,) = (trial for trial in record.trials if trial.robot == robot)
    scenes: list[Image.Image] = []
    for moment in MOMENTS:
        scene = Image.open(io.BytesIO(record.picture(trial, f"{moment}-scene"))).convert("RGB")
        eye = Image.open(io.BytesIO(record.picture(trial, f"{moment}-left"))).convert("RGB")
        scene.paste(eye, (scene.width - eye.width, 0))
        scenes.append(scene)
    return join(scenes)


def draw_worlds(draw: Callable[[World], Image.Image]) -> Image.Image:
    """Every task (rows) on every robot (columns), at the start."""
    rows: list[Image.Image] = []
    for task in TASKS:
        worlds = [World(task=load_task(task), robot=load_robot(r), seed=0) for r in list_robots()]
        rows.append(join([caption(draw(w), f"{task} · {w.robot.title}") for w in worlds]))
    return stack(rows)


def draw_eyes(world: World) -> Image.Image:
    """What the gripper's two eyes see, left and right, every pixel traced."""
    calibration = load_calibration("t265")
    camera = StereoCamera(world.model, calibration, tool_site=TOOL_SITE, full_grid=True)
    size = (calibration.width, calibration.height)
    return join([Image.frombytes("L", size, eye) for eye in camera.render(world.data)])


class Studio:
    """Draws robots in their worlds.

    Args:
        meshes: Folder of meshes, or none; robots whose model it lacks are drawn from primitives.
    """

    def __init__(self, meshes: Path | None) -> None:
        self._meshes = meshes

    def draw_portrait(self, robot: str) -> Image.Image:
        """One robot at the start of the lid task, with its title below."""
        world = World(task=load_task("lid"), robot=load_robot(robot), seed=0)
        return caption(self._draw(world, PORTRAIT_PX, PORTRAIT), world.robot.title)

    def draw_scene(self, world: World) -> Image.Image:
        """A world from its task's viewpoint."""
        return self._draw(world, SCENE_PX, world.task.scene_camera)

    def _draw(self, world: World, size: tuple[int, int], camera: SceneCamera) -> Image.Image:
        (width, height), skin = size, None
        table = world.robot.meshes
        if self._meshes is not None and table is not None:
            if (self._meshes / table.file).is_file():
                skin = dress(world, self._meshes)
            else:
                sys.stderr.write(f"{world.robot.name}: no {table.file}, drawn from primitives\n")
        renderer = SceneRenderer(world.model, width=width, height=height, supersample=2, skin=skin)
        return Image.fromarray(renderer.render(world.data, camera))


def caption(picture: Image.Image, text: str) -> Image.Image:
    """A picture with a line of text below."""
    width, height = picture.size
    captioned = Image.new("RGB", (width, height + CAPTION_PX), WHITE)
    captioned.paste(picture, (0, 0))
    place = (width / 2, height + CAPTION_PX / 2)
    font = ImageFont.load_default(size=14)
    ImageDraw.Draw(captioned).text(place, text, INK, font, anchor="mm")
    return captioned


def stack(rows: list[Image.Image]) -> Image.Image:
    """Pictures of one width below each other."""
    width, height = rows[0].size
    sheet = Image.new("RGB", (width, len(rows) * (height + EDGE_PX) - EDGE_PX), WHITE)
    for number, row in enumerate(rows):
        sheet.paste(row, (0, number * (height + EDGE_PX)))
    return sheet


def join(pictures: list[Image.Image]) -> Image.Image:
    """Pictures of one size side by side."""
    width, height = pictures[0].size
    row = Image.new("RGB", (len(pictures) * (width + EDGE_PX) - EDGE_PX, height), WHITE)
    for number, picture in enumerate(pictures):
        row.paste(picture, (number * (width + EDGE_PX), 0))
    return row


if __name__ == "__main__":
    main()
