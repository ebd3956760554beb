"""A controller of your own: a design that returns frozen gains, and a step.

Run it:     workbench verify --plant servo-axis -c my_controller:design --from 0mm --to 20mm
In a study: design = "my_controller:design" with specification = { bandwidth = 20.0 }

The design knows the plant through a linear model alone; the same object then runs on the full plant
with saturation, converters and noise. This one is for plants whose command is a force or a torque.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PID:
    """u = u0 + kp (r - y) + i - kd dy/dt, i' = ki (r - y), in SI."""

    kp: float
    ki: float
    kd: float
    rest: float  # command at the operating point
    lower: float
    upper: float
    sensors: tuple[str, ...]  # outputs that it reads
    controlled: tuple[str, ...]  # outputs that have a reference
    actuators: tuple[str, ...]  # inputs that it commands
    sample_time: float = 0.002
    name: str = "my PID"
    preview: int = 0  # future samples of the reference that it wants

    def initial_state(self, measurement):
        """Return what changes from sample to sample, at a start without a bump."""
        return 0.0, measurement[0]

    def step(self, state, measurement, reference):
        """Return the command of one sample, the next state, and what it tells about itself."""
        integral, before = state
        y, error = measurement[0], reference[0] - measurement[0]
        wanted = self.rest + self.kp * error + integral - self.kd * (y - before) / self.sample_time
        command = min(max(wanted, self.lower), self.upper)
        if command == wanted:  # anti-windup: the integral rests while the command is at its limit
            integral += self.ki * self.sample_time * error
        return (command,), (integral, y), {"integral": integral}

    def linear_command(self, command):
        """Return the command as a linear model takes it: the same where nothing is inverted."""
        return command


def design(linear, specification):
    """Place three poles at the bandwidth, in rad/s, for y'' = b u."""
    A, B, C = linear.system.A, linear.system.B, linear.system.C
    b = float((C @ A @ B)[0, 0])
    if abs(b) < 1e-12:
        raise ValueError("the command does not accelerate the output; this design is for a force")
    w = specification.get("bandwidth", 20.0)
    drive = linear.operating_point.model.inputs[0]
    return PID(
        kp=3.0 * w**2 / b,
        ki=w**3 / b,
        kd=3.0 * w / b,
        rest=float(linear.u0[0]),
        lower=drive.lower,
        upper=drive.upper,
        sensors=(linear.output_names[0],),
        controlled=(linear.output_names[0],),
        actuators=(linear.input_names[0],),
        sample_time=specification.get("sample_time", 0.002),
    )
