"""A watch as messages of ROS 2: external torque, events and contacts, and in a file the robot."""

from __future__ import annotations

import json
from typing import Any, Protocol

import numpy as np

from ...model import Model
from ...types import Array
from ...watch import Contact, Event, Note, WatchedBlocks
from ..replay.shapes import reach
from .links import Links
from .topics import TEXT, Topics, clock, header, send_frames, send_joints, send_robot, stamps

INFO, WARN = 20, 30  # levels of rcl_interfaces/Log
LONG, THICK = 0.3, 0.02  # [1] length and thickness of an arrow over the reach of the robot
ARROW, SPHERE, ADD, DELETE = 0, 2, 0, 2  # types and actions of visualization_msgs/Marker
AFTER = 1  # [s] that the arrow of the largest moment stays after the end of a contact
COLOUR = (0.9, 0.1, 0.1)


class WatchWriter(Protocol):
    """Takes what a watch found, as it is found."""

    def rows(self, rows: WatchedBlocks) -> None:
        """Write rows."""

    def event(self, event: Event, sentence: str) -> None:
        """Write an event after the rows before it."""

    def close(self) -> None:
        """End; what was written is complete."""


class WatchMessages:
    """Messages of a watch; `whole`: also joint states, /robot_description and /tf, which a running robot has itself."""

    def __init__(self, topics: Topics, model: Model, whole: bool) -> None:
        self.topics, self.whole, self.joints = topics, whole, model.robot.joints
        self.scene = Scene(model)
        self.shift: float | None = None  # [s] before 0 of the first stamp: MCAP has no time before 0

    def rows(self, rows: WatchedBlocks) -> None:
        """Write a JointState of each signal for each row."""
        self._begin(float(rows.t[0]))
        for k, stamp in enumerate(map(self._stamp, rows.t.tolist())):
            if self.whole:
                signals = {"position": rows.q[k], "velocity": rows.v[k], "effort": rows.measured[k]}
                send_joints(self.topics, "/joint_states", stamp, self.joints, **signals)
                send_frames(self.topics, "/tf", stamp, self.scene.links.poses(rows.q[k]))
            for name, x in {"predicted_torque": rows.predicted, "external_torque": rows.residual}.items():
                send_joints(self.topics, f"/signid/{name}", stamp, self.joints, effort=x[k])
            send_joints(self.topics, "/signid/threshold", stamp, self.joints, effort=rows.threshold[k])
        self.scene.q = rows.q[-1]

    def event(self, event: Event, sentence: str) -> None:
        """Write an event as JSON and as a line of a log; a contact also as an arrow."""
        topics, stamp = self.topics, self._begin(event.t)
        topics.send("/signid/events", stamp, topics.make(TEXT, data=json.dumps(event.document(), ensure_ascii=False)))
        given = {"stamp": clock(topics, stamp), "level": level(event), "name": "signid", "msg": sentence}
        topics.send("/signid/log", stamp, topics.make("rcl_interfaces/msg/Log", **given))
        if isinstance(event, Contact):
            marker = self._marker(event, stamp)
            topics.send("/signid/contacts", stamp, topics.make("visualization_msgs/msg/MarkerArray", markers=[marker]))

    def close(self) -> None:
        """End the topics."""
        self.topics.close()

    def _begin(self, t: float) -> int:
        if self.shift is None:
            self.shift = min(t, 0.0)
            if self.whole:
                send_robot(self.topics, self._stamp(t), self.scene.links)
        return self._stamp(t)

    def _stamp(self, t: float) -> int:
        return max(int(stamps(np.array([t - (self.shift or 0.0)]))[0]), 0)

    def _marker(self, contact: Contact, stamp: int) -> Any:
        """Arrow of the force on the link, its tip at the centre of mass; a sphere there if the direction is unknown."""
        make, size = self.topics.make, self.scene.reach
        tip, way = self.scene.arrow(contact)
        ends = [make("geometry_msgs/msg/Point", **dict(zip("xyz", x.tolist(), strict=True))) for x in (tip - way, tip)]
        known, turn = contact.force is not None, make("geometry_msgs/msg/Quaternion", w=1.0)
        sizes = (THICK, 2 * THICK, 4 * THICK) if known else (4 * THICK,) * 3
        given: dict[str, Any] = {"points": ends} if known else {}
        place = {} if known else {"position": ends[1]}
        if contact.end is not None:
            given["lifetime"] = make("builtin_interfaces/msg/Duration", sec=AFTER)
        return make(
            "visualization_msgs/msg/Marker",
            header=header(self.topics, stamp, self.scene.links.root),
            ns="contact",
            type=ARROW if known else SPHERE,
            action=DELETE if contact.cause else ADD,
            pose=make("geometry_msgs/msg/Pose", orientation=turn, **place),
            scale=make("geometry_msgs/msg/Vector3", **dict(zip("xyz", (size * x for x in sizes), strict=True))),
            color=make("std_msgs/msg/ColorRGBA", **dict(zip("rgba", (*COLOUR, 1.0), strict=True))),
            **given,
        )


class Scene:
    """Links of the robot and arrows of contacts."""

    def __init__(self, model: Model) -> None:
        self.links, self.reach, self.robot = Links(model.robot), reach(model.robot), model.robot
        self.bodies = model.bodies()
        self.q = np.zeros(len(model.robot.joints))  # [rad or m] of the last row

    def arrow(self, contact: Contact) -> tuple[Array, Array]:
        """Centre of mass of the link (3,) and arrow of the force (3,) in the world [m]; 0 if it is unknown."""
        body = self.robot.links.index(contact.link) + 1
        self.links.poses(self.q)
        centre = self.links.data.oMi[body].act(self.bodies.inertias[body].lever)
        return centre, LONG * self.reach * np.array(contact.force or (0.0, 0.0, 0.0))


def level(event: Event) -> int:
    """Level of an event in a log: a warning when a contact begins and for a change."""
    return INFO if isinstance(event, Note) or (isinstance(event, Contact) and event.end is not None) else WARN
