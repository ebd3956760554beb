"""A plant of your own: a function that returns its equations.

Run it:    workbench simulate --plant my_plant:rig --drive 0:5,1s:0 --duration 2s --out run.csv
Look:      workbench plants my_plant:rig
Linearise: workbench linearise --plant my_plant:rig --verdict

Everything is in SI. The keyword parameters of the function become options; a name that ends in a
unit gives it: `--option mass=3kg` or `--mass 3kg`.
"""

from workbench.model import Input, Model, Output, Parameter, State


def rig(mass_kg: float = 2.0) -> Model:
    """Build a carriage that a force drives against a damper."""

    def equations(m):
        # A port is a named place where physics may be missing: friction, a delay, an offset.
        # Laws of the library attach to it, and a diagnosis looks there. `signals` are what a law
        # may use, `disturbance` what you expect the equation to leave out there (root mean
        # square), `scale` a typical size.
        force = m.port(
            "carriage.force",
            m.u.drive - m.p.damping * m.x.speed,
            unit="N",
            scale=10.0,
            signals={"position": m.x.position, "speed": m.x.speed},
            disturbance=0.2,
        )
        # The rate of every state, then the measurement of every output.
        return {"position": m.x.speed, "speed": force / m.p.mass}, {"position": m.x.position}

    return Model(
        "rig",
        equations,
        # name, unit, typical size
        states=(State("position", "m", 0.2), State("speed", "m/s", 0.5)),
        inputs=(Input("drive", "N", 10.0, lower=-30.0, upper=30.0),),
        outputs=(Output("position", "m", 0.2, noise_rms=1e-4, display_unit="mm"),),
        parameters=(
            # fitted: a refit may change it between `lower` and `upper`.
            Parameter("mass", "kg", value=mass_kg, lower=0.5, upper=10.0, fitted=True),
            Parameter("damping", "N s/m", value=4.0, lower=0.0, upper=40.0, fitted=True),
        ),
    )
