"""Meshes in colour pictures. The gripper's eyes never see them."""

from __future__ import annotations

from services.sim.camera.meshes.hull import Hull, pack
from services.sim.camera.meshes.kernel import render_with_meshes
from services.sim.camera.meshes.room import Room, make_room
from services.sim.camera.meshes.skin import Skin

__all__ = ["Hull", "Room", "Skin", "make_room", "pack", "render_with_meshes"]
