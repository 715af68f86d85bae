"""Why attempts are aborted: every reason begins with one of these causes."""

from __future__ import annotations

from enum import StrEnum


class Cause(StrEnum):
    """What ended an attempt before it had a result."""

    NODE_LEFT = "node_left"
    """A participant's liveliness token went: it stopped, died, hung or cannot be reached."""
    ROUTER_LEFT = "router_left"
    """The router's token went too: it died, or the control plane's own link is down."""
    NODE_TIMEOUT = "node_timeout"
    """A participant that is there did not answer in time."""
    NODE_PROBLEM = "node_problem"
    """A participant said why it cannot go on, or sent what cannot be used."""
    NODE_MISSING = "node_missing"
    """There was nobody to run it with, for too long."""
    ROBOT_FAULT = "robot_fault"
    """The guard at the robot's side latched a fault."""
    EMERGENCY_STOP = "emergency_stop"
    """Somebody stopped the cell."""
    CONTROL_STOPPED = "control_stopped"
    """The control plane ended during the attempt, and has started again."""


def write_reason(cause: Cause, text: str) -> str:
    """A reason as it is stored and shown: the cause for programs, the text for people."""
    return f"{cause}: {text}"
