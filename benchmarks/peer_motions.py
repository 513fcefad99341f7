"""MuJoCo and Exudyn on mechanisms and heaps: `python peer_motions.py`, with the task on the standard input as JSON.

`benchmarks.peers` runs this file with the Python that has the programs, so it imports nothing else. Programs are
imported and models built before the clock starts; the answer is the last line of the output, as JSON.
"""

import json
import sys
from math import cos, sin, sqrt
from time import process_time

import numpy as np

GRAVITY = 9.81
ACROSS = 0.0254  # kg that an impact of the pendulum's bore feels across the link; along the link it is 0.1 kg
STIFF = 0.3  # frequency of a contact with a penalty, times the step: the most that gave smooth forces
# Mechanisms of MuJoCo: joints of a tree are exact, `connect` closes the loop of the crank. Pin and bore are a limit of
# the distance between their centres, at each of two rings: circle in circle, without friction and without ends.
LINK = """<body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
<joint axis="0 0 1" stiffness="0.01" damping="0.01"/><joint axis="0 1 0" stiffness="1e-4" damping="1e-4"/>
<joint axis="1 0 0"/><inertial pos="0 -0.1 0" mass="0.1" diaginertia="3.4e-4 1e-5 3.4e-4"/>
<site name="l0" pos="0 0 -0.01"/><site name="l1" pos="0 0 0.01"/></body>
<site name="g0" pos="0 0 -0.01"/><site name="g1" pos="0 0 0.01"/>"""
RING = """<spatial limited="true" range="0 5e-4" solreflimit="{soft}" solimplimit="0.9999 0.9999">
<site site="g{ring}"/><site site="l{ring}"/></spatial>"""
BARS = """<body><joint axis="0 0 1"/><inertial pos="0 -0.5 0" mass="1" diaginertia="1 1 0.08354166666666665"/>
<body pos="0 -1 0"><joint axis="0 0 1"/><inertial pos="0 -0.4 0" mass="0.7" diaginertia="1 1 0.03747916666666667"/>
</body></body>"""
CRANK = """<body><joint axis="0 0 1"/><inertial pos="0.0765 0 0" mass="0.038" diaginertia="1 1 7.4e-5"/>
<body name="rod" pos="0.153 0 0"><joint axis="0 0 1"/>
<inertial pos="0.153 0 0" mass="0.038" diaginertia="1 1 5.9e-4"/></body></body>
<body name="slider" pos="0.459 0 0"><joint type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="0.076" diaginertia="1 1 1"/></body>"""
CLOSED = """<equality><connect body1="rod" body2="slider" anchor="0.306 0 0" solref="{soft}" solimp="0.9999 0.9999"/>
</equality>"""
TREES = {  # bodies, what else is in the model, and positions and velocities at the start
    "clearance_pendulum": (
        LINK,
        f"<tendon>{RING.replace('{ring}', '0')}{RING.replace('{ring}', '1')}</tendon>",
        [0.0, 0.0, 0.0, 0.5, 0.0, 0.0],
        [0.0] * 6,
    ),
    "double_pendulum": (BARS, "", [1.2, -0.8], [0.0, 0.0]),
    "slider_crank": (CRANK, CLOSED, [0.0, 0.0, 0.0], [150.0, -225.0, 0.0]),
}
# Mechanisms of Exudyn: of each body mass, moment of inertia, x, y and angle of its centre of mass, velocity in y and
# spin; pins between points of two bodies, where 0 is the ground. Bodies on ideal joints are planar.
ELBOW, GUIDE, LENGTHWISE = (sin(1.2), -cos(1.2)), (0, 0.459, 0.0), 1e-5  # m; kg m2 of the link about its length
PARTS = {
    "clearance_pendulum": ([(0.1, 3.4e-4, 0.1 * sin(0.5), -0.1 * cos(0.5), 0.5, 0.0, 0.0)], []),
    "double_pendulum": (
        [
            (1.0, 0.08354166666666665, 0.5 * ELBOW[0], 0.5 * ELBOW[1], 1.2, 0.0, 0.0),
            (0.7, 0.03747916666666667, ELBOW[0] + 0.4 * sin(0.4), ELBOW[1] - 0.4 * cos(0.4), 0.4, 0.0, 0.0),
        ],
        [((0, 0.0, 0.0), (1, 0.0, 0.5)), ((1, 0.0, -0.5), (2, 0.0, 0.4))],
    ),
    "slider_crank": (
        [
            (0.038, 7.4e-5, 0.0765, 0.0, 0.0, 11.475, 150.0),
            (0.038, 5.9e-4, 0.306, 0.0, 0.0, 11.475, -75.0),
            (0.076, 2.7e-6, 0.459, 0.0, 0.0, 0.0, 0.0),
        ],
        [
            ((0, 0.0, 0.0), (1, -0.0765, 0.0)),
            ((1, 0.0765, 0.0), (2, -0.153, 0.0)),
            ((2, 0.153, 0.0), (3, 0.0, 0.0)),
            (GUIDE, (3, 0.0, 0.0)),
        ],
    ),
}


def mujoco(motion, step, every, count, integrator):
    """Return what is compared at each instant, and the processor time of all steps [s]."""
    import mujoco as mj

    bodies, more, q, v = TREES[motion]
    # the hardest that MuJoCo allows: what violates a limit or a loop decays within two steps
    more = more.replace("{soft}", f"{2 * step} 1")
    model = mj.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian" inertiafromgeom="false"/><option timestep="{step}" gravity="0 {-GRAVITY} 0"
        integrator="{integrator}" tolerance="1e-12"/><worldbody>{bodies}</worldbody>{more}</mujoco>"""
    )
    data = mj.MjData(model)
    data.qpos, data.qvel = q, v
    steps, found = round(every / step), np.zeros((count, model.nq))
    began = process_time()
    for row in found:
        mj.mj_step(model, data, steps)
        row[:] = data.qpos
    spent = process_time() - began
    if motion == "clearance_pendulum":
        return (found[:, :1] + 0.2 * np.sin(found[:, 3:4])).tolist(), spent
    return np.cumsum(found[:, :2], axis=1).tolist(), spent


def exudyn(motion, step, every, count, integrator):
    """Return what is compared at each instant, and the processor time of all steps [s]."""
    import exudyn as exu
    from exudyn import itemInterface as items
    from exudyn.utilities import RigidBodyInertia, RotationMatrixZ

    system = exu.SystemContainer().AddSystem()
    ground, (bodies, pins) = system.AddObject(items.ObjectGround()), PARTS[motion]
    made, planar, rows = [ground], bool(pins), []
    for mass, inertia, x, y, angle, velocity, spin in bodies:
        body = system.CreateRigidBody(
            inertia=RigidBodyInertia(mass, np.diag([inertia, LENGTHWISE, inertia])),
            nodeType=exu.NodeType.RotationRxyz,
            referencePosition=[x, y, 0.0],
            referenceRotationMatrix=RotationMatrixZ(angle),
            initialVelocity=[0.0, velocity, 0.0],
            initialAngularVelocity=[0.0, 0.0, spin],
            gravity=[0.0, -GRAVITY, 0.0],
            create2D=planar,
        )
        made.append(body)

    def markers(*places):
        """Return a marker for each body and point, from its centre of mass."""
        return [system.AddMarker(items.MarkerBodyRigid(bodyNumber=made[i], localPosition=at)) for i, *at in places]

    for first, second in pins:
        joint = items.ObjectJointPrismatic2D if first == GUIDE else items.ObjectJointRevolute2D
        system.AddObject(joint(markerNumbers=markers((*first, 0.0), (*second, 0.0))))
    for z in () if planar else (-0.01, 0.01):
        # A ball in a hollow ball at each ring, in the plane a pin in its bore; a penalty without rebound.
        stiffness = ACROSS / 2 * (STIFF / step) ** 2
        state = items.NodeGenericData(numberOfDataCoordinates=4, initialCoordinates=[0.0] * 4)
        pair = items.ObjectContactSphereSphere(markerNumbers=markers((0, 0.0, 0.0, z), (1, 0.0, 0.1, z)))
        pair.nodeNumber, pair.spheresRadii, pair.isHollowSphere1 = system.AddNode(state), [0.01, 0.0105], True
        pair.contactStiffness, pair.contactDamping = stiffness, 2 * sqrt(stiffness * ACROSS / 2)
        system.AddObject(pair)
    if not planar:
        turn = items.NodeGenericData(numberOfDataCoordinates=1, initialCoordinates=[0.0])
        ends = markers((0, 0.0, 0.0, 0.0), (1, 0.0, 0.0, 0.0))
        spring = items.ObjectConnectorTorsionalSpringDamper(markerNumbers=ends)
        spring.nodeNumber, spring.stiffness, spring.damping = system.AddNode(turn), 0.01, 0.01
        system.AddObject(spring)
    for body in made[1:3]:
        kind = exu.OutputVariableType.Coordinates if planar else exu.OutputVariableType.Position
        sensor = items.SensorBody(bodyNumber=body, localPosition=[0, -0.1, 0], storeInternal=True)
        if planar:
            sensor = items.SensorNode(nodeNumber=system.GetObject(body)["nodeNumber"], storeInternal=True)
        sensor.outputVariableType = kind
        rows.append(system.AddSensor(sensor))
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(every * count / step)
    settings.timeIntegration.endTime = every * count
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = every
    began = process_time()
    system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, integrator))
    spent = process_time() - began
    found = np.stack([np.asarray(system.GetSensorStoredData(row))[1:, 3 if planar else 1] for row in rows], axis=1)
    return (found + [part[4] for part in bodies[: len(rows)]] if planar else found).tolist(), spent


def heap(centres, masses, friction, hard):
    """Return time [ms] and forces [N] of the solver in the first step of a heap of balls, and how 100 steps go on."""
    import mujoco as mj

    step = 1e-3
    soft = f'solref="{2 * step} 1" solimp="0.9999 0.9999"' if hard else ""  # else MuJoCo's own
    balls = "".join(
        f'<body pos="{x} {y} {z}"><freejoint/><inertial pos="0 0 0" mass="{m}" diaginertia="{m / 10} {m / 10} {m / 10}"'
        f'/><geom size="0.500000001" friction="{friction} 0 0" {soft}/></body>'  # a little larger: all touch
        for (x, y, z), m in zip(centres, masses, strict=True)
    )
    model = mj.MjModel.from_xml_string(
        f"""<mujoco><compiler inertiafromgeom="false"/><option timestep="{step}" gravity="0 0 {-GRAVITY}"
        cone="elliptic" solver="Newton" tolerance="1e-10" iterations="1000"/><worldbody>
        <geom type="plane" size="9 9 1" friction="{friction} 0 0" {soft}/>{balls}</worldbody></mujoco>"""
    )
    data, best, force, forces = mj.MjData(model), np.inf, np.zeros(6), []
    mj.mj_forward(model, data)
    for _ in range(3):
        data.qacc_warmstart[:] = 0.0
        began = process_time()
        mj.mj_fwdConstraint(model, data)
        best = min(best, process_time() - began)
    for i, contact in enumerate(data.contact):
        mj.mj_contactForce(model, data, i, force)
        # geometry 0 is the floor, -1 here as in the heap; the force acts on the second body
        forces.append([*(int(each) - 1 for each in contact.geom), *(contact.frame.reshape(3, 3).T @ force[:3])])
    iterations, began = int(data.solver_niter[0]), process_time()
    mj.mj_step(model, data, 100)
    spent, deepest = process_time() - began, -min(contact.dist for contact in data.contact)
    return {"ms": 1e3 * best, "iterations": iterations, "forces": forces, "step_ms": 10 * spent, "deepest": deepest}


def main(call, repeats=1, **task):
    """Answer a task: a motion with the shortest of several times, or a heap."""
    if call == "heap":
        return heap(**task)
    answers = [{"mujoco": mujoco, "exudyn": exudyn}[call](**task) for _ in range(repeats)]
    return {"found": answers[0][0], "s": min(spent for _, spent in answers)}


if __name__ == "__main__":
    print(json.dumps(main(**json.load(sys.stdin))))
