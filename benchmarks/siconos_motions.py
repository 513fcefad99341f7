"""Siconos on complete motions: `python3 siconos_motions.py OUT.npz STEP`.

`benchmarks.against_siconos` runs this file with the Python that has Siconos, so it imports only NumPy and Siconos. The
time stepping is the scheme of Moreau and Jean with theta = 1/2, the coordinates are minimal. That module
describes the same three motions for clearcap.
"""

import sys
from time import process_time

import numpy as np
import siconos.kernel as sk

GRAVITY = 9.81


def bouncing_ball():
    """Return body, contact and solver of a ball that falls 0.9 m; its coordinate is the height."""
    body = sk.LagrangianLinearTIDS([0.9], [0.0], [[1.0]])
    body.setFExtPtr([-GRAVITY])
    return body, sk.Interaction(sk.NewtonImpactNSL(0.8), sk.LagrangianLinearTIR([[1.0]])), sk.LCP(), 3.0


def slider():
    """Return body, contact and solver of a mass at 2 m/s on a floor with friction 0.2; coordinates: path and height."""
    body = sk.LagrangianLinearTIDS([0.0, 0.0], [2.0, 0.0], np.eye(2))
    body.setFExtPtr([0.0, -GRAVITY])
    relation = sk.LagrangianLinearTIR([[0.0, 1.0], [1.0, 0.0]])
    law = sk.NewtonImpactFrictionNSL(0.0, 0.0, 0.2, 2)
    return body, sk.Interaction(law, relation), sk.FrictionContact(2), 1.5


class Pendulum(sk.LagrangianDS):
    """A mass of 1 kg at 1 m from its pivot, with an inertia of 0.01 kg m2; its coordinate is the angle."""

    def computeFExt(self, time, *state):
        """Set the torque of gravity at the present angle."""
        self.setFExtPtr([-GRAVITY * np.sin(self.q()[0])])


def pendulum():
    """Return body, contact and solver of a pendulum that swings from 1 rad against a stop at its lowest point."""
    body = Pendulum([1.0], [0.0], [[1.01]])
    body.computeFExt(0.0)
    return body, sk.Interaction(sk.NewtonImpactNSL(0.7), sk.LagrangianLinearTIR([[1.0]])), sk.LCP(), 3.0


def main(target: str, step: float) -> None:
    """Simulate each motion; write its first coordinate after every step, and the processor time per step [us]."""
    found = {}
    for describe in (bouncing_ball, slider, pendulum):
        body, contact, solver, duration = describe()
        model = sk.NonSmoothDynamicalSystem(0.0, duration)
        model.insertDynamicalSystem(body)
        model.link(contact, body)
        stepping = sk.TimeStepping(model, sk.TimeDiscretisation(0.0, step), sk.MoreauJeanOSI(0.5), solver)
        stepping.setNewtonTolerance(1e-12)
        path, began = [], process_time()
        while stepping.hasNextEvent():
            stepping.computeOneStep()
            path.append(float(body.q()[0]))
            stepping.nextStep()
        found[describe.__name__] = np.array(path)
        found[f"{describe.__name__}_us"] = 1e6 * (process_time() - began) / len(path)
    np.savez(target, **found)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
