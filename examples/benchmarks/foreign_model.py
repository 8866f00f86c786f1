"""MuJoCo's XML of a body on the ground, and of the fingertips that push it."""

import numpy as np
from foreign_paths import STEP

TIP_MASS = 0.05  # [kg] of a fingertip
MAX_FORCE = 4.0  # [N] of a servo


def model_of(box, world) -> str:
    """Return MuJoCo's XML of box, ground and fingertips."""
    moments, points = box.inertia, box.points
    inertia = f'diaginertia="{text(np.diag(moments))}"'
    if points is not None:
        products = moments[[0, 0, 1], [1, 2, 2]]
        inertia = f'fullinertia="{text(np.r_[np.diag(moments), products])}"'
    body, mesh = f'type="box" size="{text(box.sides / 2)}"', ""
    if world.edge and points is None:
        points = rounded(box.sides, world.edge)
    if points is not None:
        body = 'type="mesh" mesh="box"'
        mesh = (
            f'<asset><mesh name="box" inertia="exact" vertex="{text(points)}"/></asset>'
        )
    soft = 'solref="{}" solimp="{}"'.format
    mu = box.ground * (1 + world.by_direction * np.array([1, -1]))
    contact = 4 if world.torsion else 3
    away, wall = world.wall + np.linalg.norm(box.sides[:2]) / 2, ""
    if world.wall:
        wall = f"""<geom type="plane" size="1 1 1" pos="{away} 0 0" euler="0 -90 0"
            friction="0.3 0 0"/>"""
    tips, servos = fingers_of(box, world, soft)
    return f"""<mujoco><option timestep="{STEP}" cone="elliptic" impratio="10"
        integrator="implicitfast"/>
        <default><geom condim="3" {soft(*world.contact)}/></default>{mesh}
        <worldbody><geom name="ground" type="plane" size="1 1 1"
            euler="{world.tilt} 0 0"/>{wall}
        <body><freejoint/><inertial pos="{text(world.centre * box.sides)}"
            mass="{box.mass}" {inertia}/>
            <geom name="box" {body} friction="0 0 0"/></body>{tips}</worldbody>
        <contact><pair geom1="ground" geom2="box" condim="{contact}"
            {soft(*world.contact)} friction="{text(mu)} {world.torsion} 0 0"/></contact>
        <actuator>{servos}</actuator></mujoco>"""


def fingers_of(box, world, soft) -> tuple[str, str]:
    """Return the XML of the fingertips and of their servos; soft: of a contact."""
    tip = f'{soft(*world.tip)} priority="1"' if world.tip else ""
    axes = "".join(f'<joint type="slide" name="{{0}}{e}" axis="{text(row)}"/>'
                   for e, row in enumerate(np.eye(3)))  # fmt: skip
    tips = "".join(
        f"""<body gravcomp="1">{axes.format(f"f{f}")}<geom type="sphere" {tip}
            size="{world.radius}" mass="{TIP_MASS}"
            friction="{box.finger} 0 0"/></body>"""
        for f in range(world.fingers)
    )
    kv = 2 * (world.stiffness * (TIP_MASS + box.mass)) ** 0.5
    servos = "".join(
        f"""<position joint="f{f}{e}" kp="{world.stiffness}" kv="{kv}"
            forcelimited="true" forcerange="{-MAX_FORCE} {MAX_FORCE}"/>"""
        for f in range(world.fingers) for e in range(3)
    )  # fmt: skip
    return tips, servos


def rounded(sides, edge: float) -> np.ndarray:
    """Return points (V, 3) [m] whose hull is a box with edges of a radius [m]."""
    angles = np.linspace(0, np.pi / 2, 7)
    u, v = np.meshgrid(angles, angles)
    ball = np.stack([np.cos(u) * np.cos(v), np.cos(u) * np.sin(v), np.sin(u)], axis=-1)
    corner = sides / 2 - edge + edge * ball.reshape(-1, 3)
    signs = np.indices((2, 2, 2)).reshape(3, 8).T * 2 - 1
    return np.unique((signs[:, None] * corner).reshape(-1, 3).round(9), axis=0)


def text(numbers) -> str:
    """Return numbers as MuJoCo's XML has them."""
    return " ".join(map(repr, np.ravel(numbers).tolist()))
