"""A task of your own in JAX: swing up a double pendulum on a cart, with equations from its energies.

Usage: python examples/11_cart_double_pendulum.py [FRAMES]. The default, 50,000 frames, only shows that it
runs; the default preset had a mean return of 461 of 600 after 3,000,000 (seed 0, its best 510).
"""

import sys

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from swingup import AREAPO
from swingup.common.types import Action, Key, Observation, Scalar
from swingup.learner.progress import TrainingReport
from swingup.tasks.task import AbstractTask, Step, check_energy

CART, LINK, LENGTH, GRAVITY = 1.0, 0.5, 0.5, 9.81  # Masses of the cart and of each link's tip (kg), m, m/s²
FORCE, RAIL, SUBSTEPS, PERIOD = 20.0, 2.4, 10, 0.02  # N, half the rail's length (m), steps of RK4 in a period (s)
STEPS = 600  # An episode's limit

State = tuple[Float[Array, "6"], Array]
"""[x, a, b, x', a', b'] (m, rad, rad from upright and their rates), and the steps so far."""


def energies(q: Float[Array, "3"], v: Float[Array, "3"]) -> tuple[Scalar, Scalar]:
    """Kinetic and potential energy (J) of two point masses on rods, above a cart."""

    def places(q: Array) -> Array:
        joint = jnp.array([q[0] + LENGTH * jnp.sin(q[1]), LENGTH * jnp.cos(q[1])])
        tip = joint + LENGTH * jnp.array([jnp.sin(q[2]), jnp.cos(q[2])])
        return jnp.stack([joint, tip])

    heights, rates = places(q)[:, 1], jax.jvp(places, (q,), (v,))[1]
    return 0.5 * CART * v[0] ** 2 + 0.5 * LINK * jnp.sum(rates**2), LINK * GRAVITY * jnp.sum(heights)


def energy(state: State) -> Scalar:
    """Kinetic and potential energy together (J)."""
    kinetic, potential = energies(state[0][:3], state[0][3:])
    return kinetic + potential


def derivative(z: Float[Array, "6"], force: Scalar) -> Float[Array, "6"]:
    """Lagrange's equations d/dt ∂L/∂v = ∂L/∂q + (force, 0, 0), of which JAX finds every term."""

    def lagrangian(q: Array, v: Array) -> Scalar:
        kinetic, potential = energies(q, v)
        return kinetic - potential

    q, v = z[:3], z[3:]
    mass = jax.hessian(lagrangian, 1)(q, v)
    transport = jax.jvp(lambda q: jax.grad(lagrangian, 1)(q, v), (q,), (v,))[1]
    pull = jax.grad(lagrangian, 0)(q, v) + jnp.array([force, 0.0, 0.0])
    return jnp.concatenate([v, jnp.linalg.solve(mass, pull - transport)])


def rk4(z: Float[Array, "6"], force: Scalar, dt: float) -> Float[Array, "6"]:
    """One step of the classical Runge-Kutta method."""
    k1 = derivative(z, force)
    k2 = derivative(z + 0.5 * dt * k1, force)
    k3 = derivative(z + 0.5 * dt * k2, force)
    return z + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + derivative(z + dt * k3, force))


class CartDoublePendulum(AbstractTask[State]):
    """From hanging to upright by three forces; leaving the rail ends an episode."""

    @property
    def choices(self) -> tuple[int, ...]:
        """Force to the left, none, to the right."""
        return (3,)

    @property
    def observation_size(self) -> int:
        """Eight: see :meth:`observe`."""
        return 8

    @property
    def action_size(self) -> int:
        """One choice."""
        return 1

    def reset(self, key: Key) -> State:
        """Hang nearly at rest."""
        return jnp.array([0.0, jnp.pi, jnp.pi, 0.0, 0.0, 0.0]) + 0.02 * jax.random.normal(key, (6,)), jnp.array(0)

    def observe(self, state: State) -> Observation:
        """Place, sines and cosines of the angles, rates; each of about 1."""
        (x, a, b, *rates), _ = state
        angles = [jnp.sin(a), jnp.cos(a), jnp.sin(b), jnp.cos(b)]
        return jnp.array([x / RAIL, *angles, rates[0] / 4, rates[1] / 10, rates[2] / 10])

    def step(self, state: State, action: Action, key: Key) -> Step[State]:
        """Reward the height of the tip, five times as much near the top."""
        z, steps = state
        force = FORCE * (action[0] - 1.0)
        z = jax.lax.fori_loop(0, SUBSTEPS, lambda _, z: rk4(z, force, PERIOD / SUBSTEPS), z)
        after = z, steps + 1
        tip = 0.5 * (jnp.cos(z[1]) + jnp.cos(z[2]))
        reward = 0.5 * (1.0 + tip) * jnp.where(tip > 0.95, 1.0, 0.2)
        return Step(after, self.observe(after), reward, jnp.abs(z[0]) > RAIL, steps + 1 >= STEPS)


def main(frames: int) -> None:
    """Check the integrator, learn, and judge."""
    thrown = jax.random.normal(jax.random.key(0), (32, 6)) * jnp.array([0.1, 2.0, 2.0, 1.0, 5.0, 5.0])
    # Choice 1 is no force.
    gain = check_energy(CartDoublePendulum(), energy, (thrown, jnp.zeros(32, int)), [1])
    print(f"without a force it gains {gain:.1e} of its range of energies")
    model = AREAPO(CartDoublePendulum(), num_envs=16)

    def show(_: AREAPO, report: TrainingReport) -> None:
        print(f"{report.frames:9,} frames: mean return {report.score:.1f} of {STEPS}")

    model.learn(frames, show)
    print(model.evaluate(episodes=10))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50_000)
