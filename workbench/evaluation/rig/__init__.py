"""An independent second implementation of the arm: the ground truth that the diagnosis is tried on.

The rig shares no physics with the product. It keeps mass and internal energy as the states of the
gas (the product keeps pressure and temperature), has its own integrator, and hides effects that the
nominal plant does not contain; its recordings are what plant and diagnosis are tried on.

Modules: `parameters` (names, units, nominal values), `effects` (switches), `plant` (geometry,
muscles, state vector, derivative) with `rig.c` (repeats fixed steps of a Runge-Kutta rule),
`electronics`, `simulate` (a command or a controller in, records out), `excitation` and `cases`
(folders in the recording format).
"""
