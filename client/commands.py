"""The arguments of every verb. Field names are the options, docstrings are the help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, UseAppendAction, arg

Repeated = UseAppendAction[tuple[str, ...]]
"""Given several times. Its default is filled in by the verb: given values would be added to it."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """What every verb takes."""

    debug: bool = False
    """Show the traceback of an error."""


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Start everything, evaluate the lid task on two robots, write a report, stop everything."""

    policy: str = "legato-lid"
    """Who acts: the learned policy that comes with LEGATO, or expert, the scripted one."""
    trials: int = 5
    """Trials per robot."""
    seed: int = 0
    """Seed of the first trial's scene."""
    cells: int = 2
    """Simulation processes that share the trials."""
    data: Path = Path("runs")
    """Folder in which a new folder for this run is made."""


@dataclass(frozen=True, kw_only=True)
class DemoRecord(Command):
    """Record demonstrations by the scripted expert; the same command again goes on."""

    task: str = "lid"
    """Task to demonstrate."""
    robot: str = "abstract"
    """Robot that carries the gripper."""
    policy: str = "expert"
    """Who demonstrates: expert, or expert-noisy, which is pushed off its path now and then."""
    episodes: int = 150
    """Successful demonstrations that are wanted."""
    out: Path | None = None
    """Folder of the data set; without it runs/demonstrations/TASK-ROBOT-SEED."""
    seed: int = 0
    """Seed of the first trial; the others follow from it, as in an evaluation."""
    workers: int = 0
    """Processes; 0 = one per core. What is recorded does not depend on it."""
    keep_failed: bool = False
    """Store failed demonstrations too; they do not count as wanted."""
    camera: str = "t265"
    """Calibration of the stereo camera."""
    tracking_lag_ms: float = 0.0
    """Let the hand lag behind; each trial draws its time constant, up to this [ms]."""
    action_latency_ms: float = 0.0
    """Let actions take effect late; each trial draws its latency, up to this [ms]."""
    randomise_camera: bool = False
    """Vary exposure, vignette and noise of the images, trial by trial."""


@dataclass(frozen=True, kw_only=True)
class Train(Command):
    """Train a policy on demonstrations; the same command again goes on where it stopped."""

    task: str = "lid"
    """Task of the demonstrations."""
    policy: Literal["legato", "legato-se3", "bc-rnn"] = "legato"
    """Method; legato-se3 is LEGATO without the motion-invariant loss."""
    size: Literal["compact", "small", "medium", "large", "paper"] = "compact"
    """Size of the network; compact trains on two CPU cores."""
    data: Repeated = ()
    """Folder of a data set; again for more (default: runs/demonstrations/TASK-abstract-0)."""
    episodes: int | None = None
    """Use only the first so many of each data set; without it all."""
    out: Path | None = None
    """Folder of the run; without it runs/training/TASK-POLICY-SIZE-SEED."""
    timesteps: int = 1_000_000
    """Budget in frames, repetitions included."""
    pretraining: int = 80_000
    """Frames that the encoders are trained on first, alone; the paper's size has no such part."""
    batch: int = 16
    """Windows per update, over all processes."""
    learning_rate: float | None = None
    """Peak of AdamW's rate; without it 7e-4, for the paper's size 1e-4."""
    invariant_weight: float | None = None
    """Weight of the motion-invariant loss; without it that of the size."""
    window: int = 20
    """Frames per window; at run time the recurrent state is reset as often."""
    precision: Literal["bf16", "fp32"] = "bf16"
    """Of the forward pass; weights are float32."""
    seed: int = 0
    """Decides initial weights, windows and variation of the images."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N; under torchrun each process takes its own."""
    threads: int = 0
    """Of PyTorch on the CPU; 0 = all cores, shared with the processes of torchrun."""
    validate_every: int = 500
    """Updates between two looks at the held-out demonstrations."""
    evaluate_trials: int = 0
    """Closed-loop trials at every validation and at the end; 0 = none."""
    evaluate_robot: Repeated = ()
    """Robot of those trials; give it again for more (default: abstract)."""
    tensorboard: bool = False
    """Also log for TensorBoard, which is the extra `tensorboard`."""


@dataclass(frozen=True, kw_only=True)
class Up(Command):
    """Start the services of one machine and leave them running."""

    robot: Repeated = ()
    """Robot that gets a retargeter; give it again for more (default: abstract, panda)."""
    cells: int = 1
    """Simulation processes; each runs one trial at a time."""
    port: int = 8000
    """TCP port of the control plane (REST)."""
    router_port: int = 7447
    """TCP port of the Zenoh router."""
    namespace: str = "legato"
    """Prefix of every key on the bus; keeps deployments apart."""
    data: Path = Path("runs")
    """Folder of results, logs and the state file."""
    checkpoints: Path | None = None
    """Folder whose checkpoints are served under their folders' names, beside the shipped ones."""
    certs: Path | None = None
    """Folder that `legato certs create` made: encrypt the bus, let each role do only its own."""
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = "INFO"
    """Least level that the services log."""
    lease_s: float | None = None
    """Seconds until a silent process counts as lost (1, encrypted 2); 10 for a busy machine."""
    metrics_port: int | None = None
    """TCP port of the router's metrics for Prometheus; the other processes take the next ones."""
    foreground: bool = False
    """Stay attached and stop everything on Ctrl-C."""
    compose: bool = False
    """In containers: `docker compose up --wait` on the compose.yaml of the current folder."""


@dataclass(frozen=True, kw_only=True)
class Down(Command):
    """Stop the services that `legato up` started."""

    data: Path = Path("runs")
    """Folder that was given to `legato up`."""
    compose: bool = False
    """Containers: `docker compose down`; results stay in their volume."""


@dataclass(frozen=True, kw_only=True)
class Status(Command):
    """Show the running services; exit code 1 if there are none."""

    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class Stop(Command):
    """Emergency stop: robots brake and hold their pose until `legato reset`.

    Software: it needs a running control plane and bus, and replaces no safety-rated stop.
    """

    cell: Repeated = ()
    """Cell to stop; give it again for more (default: all)."""
    reason: str = ""
    """Why, for the trials that end by it."""
    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class Reset(Command):
    """Release emergency stops and faults of cells whose robots are at rest."""

    cell: Repeated = ()
    """Cell to release; give it again for more (default: all)."""
    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class Eval(Command):
    """Evaluate policies: every task on every robot with every policy, on equal seeds."""

    task: Repeated = ()
    """Task; give it again for a grid (default: lid)."""
    robot: Repeated = ()
    """Robot; give it again for a grid (default: abstract, panda)."""
    policy: Repeated = ()
    """Policy, or with --in-process also a checkpoint's folder as PATH/NAME; give it again for a
    grid (default: expert)."""
    trials: int = 5
    """Trials per task, robot and policy."""
    seed: int = 0
    """Seed of the first trial; the others follow from it."""
    mode: Literal["lockstep", "realtime"] = "lockstep"
    """Lockstep repeats bit for bit; realtime waits for nobody, as hardware does."""
    camera: str = "t265"
    """Calibration of the stereo camera."""
    full_grid: bool = False
    """Trace every pixel of the images: slower, exact."""
    action_latency_ms: float = 0.0
    """Lockstep: modelled time from a frame to its action's effect [ms]."""
    tracking_lag_ms: float = 0.0
    """Let every robot's hand lag behind its reference with this time constant [ms]."""
    randomise_camera: bool = False
    """Vary exposure, vignette and noise of the images, by the trial's seed."""
    in_process: bool = False
    """Run everything inside this process, without services."""
    workers: int | None = None
    """Run it in so many processes of this machine, without services, as shards in --out."""
    ray: bool = False
    """With --workers: as tasks of Ray, on the cluster of RAY_ADDRESS."""
    shard: str | None = None
    """Run only shard i of n, as i/n with i from 0, without services; run again, it goes on."""
    out: Path | None = None
    """Folder that all shards of one evaluation share."""
    pictures: bool = False
    """With --shard: keep the pictures that a report shows."""
    json: bool = False
    """Print one JSON object instead of the table."""
    report: Path | None = None
    """Also write the results as one HTML file."""
    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""


@dataclass(frozen=True, kw_only=True)
class EvalMerge(Command):
    """Join the shards of an evaluation and show the results as a single run does."""

    folder: Positional[Path]
    """Folder that was given to the shards as --out."""
    json: bool = False
    """Print one JSON object instead of the table."""
    report: Path | None = None
    """Also write the results as one HTML file."""


@dataclass(frozen=True, kw_only=True)
class Report(Command):
    """Write an evaluation as one HTML file that needs nothing else."""

    evaluation: Positional[str]
    """Id of the evaluation, as `legato eval` prints it."""
    out: Path = Path("report.html")
    """File to write."""
    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""


@dataclass(frozen=True, kw_only=True)
class PolicyList(Command):
    """List the policies that running policy services offer."""

    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class PolicyLoad(Command):
    """Load a checkpoint into running policy services, without a restart.

    A learned policy of the same name is replaced; running episodes keep what they began with.
    """

    name: Positional[str]
    """Name under which evaluations choose it."""
    folder: Positional[str]
    """Folder of the checkpoint on the host of the policy service."""
    node: str | None = None
    """Policy service (default: all)."""
    url: str = "http://127.0.0.1:8000"
    """Where the control plane answers."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class KeysCreate(Command):
    """Make an API key: print it once, and keep its hash in a file for the control plane."""

    name: str
    """Who it is for; the control plane's log names it."""
    role: Literal["view", "operate", "admin"]
    """view reads, operate also starts and stops evaluations, admin also loads policies."""
    file: Path
    """File of hashes, which is made if need be."""


@dataclass(frozen=True, kw_only=True)
class KeysList(Command):
    """List the API keys of a file: names, roles, when they were made."""

    file: Path
    """File of hashes."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class KeysRevoke(Command):
    """Remove an API key from a file; a control plane that reads the file refuses it at once."""

    name: str
    """Name of the key."""
    file: Path
    """File of hashes."""


@dataclass(frozen=True, kw_only=True)
class RobotList(Command):
    """List every robot: joints, mass without gripper, reach at table height."""

    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class RobotCheck(Command):
    """Check a robot's model, reach and joint margins; exit code 1 if something is wrong."""

    robot: Positional[str]
    """Name of a robot, or a folder with model.xml and robot.toml."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class DataView(Command):
    """Show the episodes of a data set."""

    folder: Positional[Path]
    """Folder of the data set."""
    episode: int = 0
    """Episode of sheet and video, from 0."""
    sheet: Path | None = None
    """Also draw images of that episode over time: a PNG file to write."""
    video: Path | None = None
    """Also draw that episode from the task's viewpoint: a .webp, .gif or .png file to write."""
    meshes: Path | None = None
    """Copy of MuJoCo Menagerie: the video shows its meshes. Else LEGATO_MENAGERIE, if set."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class DataCheck(Command):
    """Check a data set: hashes, columns, motion, replay; exit code 1 if something is wrong."""

    folder: Positional[Path]
    """Folder of the data set."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class DataExport(Command):
    """Write a data set in another format: robomimic's HDF5 file, or a LeRobotDataset v3.0."""

    folder: Positional[Path]
    """Folder of the data set."""
    to: Literal["robomimic", "lerobot"]
    """Format; what robomimic has can be imported again bit for bit, LeRobot's videos are lossy."""
    out: Path
    """File (robomimic) or folder (lerobot) to make."""
    channels: Literal[1, 3] | None = None
    """robomimic: of each image (default: 3, the gray level repeated, as robomimic asks for)."""
    codec: Literal["av1", "h264"] | None = None
    """lerobot: of the videos (default: av1)."""


@dataclass(frozen=True, kw_only=True)
class DataImport(Command):
    """Make a data set of a robomimic file; one that LEGATO exported needs no options."""

    file: Positional[Path]
    """HDF5 file."""
    from_: Annotated[Literal["robomimic"], arg(name="from")]
    """Format."""
    out: Path
    """Folder of the data set to make."""
    task: str | None = None
    """Task that is demonstrated."""
    robot: str | None = None
    """Robot that carries the gripper."""
    camera: str = "t265"
    """Calibration of the stereo camera."""
    rate_hz: float = 10.0
    """Rows per second."""
    rotations: Literal["vector", "rpy"] | None = None
    """Of the actions: rotation vectors, or roll-pitch-yaw about fixed x, y, z."""
    metres: float = 1.0
    """Metres per unit of the translations."""
    radians: float = 1.0
    """Radians per unit of the rotations."""
    left: str = "left_gray"
    """Observation with the left eye's images."""
    right: str = "right_gray"
    """Observation with the right eye's images."""
    mirrored: bool = False
    """The images are mirrored left-right: turn them back."""
    keep_idle: bool = False
    """Keep the frames at the start in which nothing is done yet."""


@dataclass(frozen=True, kw_only=True)
class CertsCreate(Command):
    """Make an authority and one certificate per role, for an encrypted bus with access control."""

    out: Path = Path("certs")
    """New folder: the authority, and a folder per role to copy to its machine."""
    host: Repeated = ()
    """Name or address under which other machines reach the router; give it again for more."""
    days: int = 365
    """How long the certificates of the roles are valid; the authority lasts ten years."""


@dataclass(frozen=True, kw_only=True)
class CertsAdd(Command):
    """Make one more certificate with the authority that is there: a further host, or a new key."""

    role: Positional[str]
    """Role, as in docs/security.md."""
    out: Path = Path("certs")
    """Folder of the authority."""
    name: str | None = None
    """Folder of the certificate in there (default: the role)."""
    cell: Repeated = ()
    """Only cell in which it has rights (x*: those that begin so); repeat for more; revocable."""
    host: Repeated = ()
    """Router: name or address under which other machines reach it; give it again for more."""
    days: int = 365
    """How long it is valid."""


@dataclass(frozen=True, kw_only=True)
class CertsList(Command):
    """List the certificates of an authority: role, cells, until when, since when revoked."""

    out: Path = Path("certs")
    """Folder of the authority."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class CertsRevoke(Command):
    """Take the rights of a certificate away that was made with --cell."""

    name: Positional[str]
    """Name of the certificate."""
    out: Path = Path("certs")
    """Folder of the authority."""


@dataclass(frozen=True, kw_only=True)
class Bus(Command):
    """What every command on the bus takes."""

    endpoint: str = "tcp/127.0.0.1:7447"
    """Address of the Zenoh router."""
    namespace: str = "legato"
    """Prefix of every key of the deployment."""
    certs: Path | None = None
    """Folder of a certificate of the role viewer, for an endpoint tls/HOST:PORT."""


@dataclass(frozen=True, kw_only=True)
class TopicList(Bus):
    """List every topic with its usual rate and what is seen now."""

    duration_s: float = 1.0
    """How long to listen [s]."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True, kw_only=True)
class TopicEcho(Bus):
    """Print messages as JSON lines; images as their size."""

    topic: Positional[str]
    """Topic, e.g. robot/state."""
    cell: str = "*"
    """Cell or node; * = all."""
    count: int = 0
    """Stop after this many messages; 0 = go on until Ctrl-C."""


@dataclass(frozen=True, kw_only=True)
class TopicHz(Bus):
    """Measure the rate of messages and the gaps between them, per key."""

    topic: Positional[str]
    """Topic, e.g. robot/state."""
    cell: str = "*"
    """Cell or node; * = all."""
    duration_s: float = 5.0
    """How long to listen [s]."""
    json: bool = False
    """Print one JSON object."""
