"""An independent second implementation of the arm: the ground truth that the diagnosis is tried on.

The rig shares no code with the product. It keeps mass and internal energy as the states of the gas
(the product keeps pressure and temperature), has its own integrators, and hides effects that the
nominal plant does not contain; its recordings are what plant and diagnosis are tried on.

Modules: `parameters` (names, units, nominal values), `effects` (switches), `muscle`, `hysteresis`,
`friction`, `valve`, `arm` (the laws), `plant` (state vector and derivative, plain Python),
`plant.c` with `fast` (the same derivative compiled, fixed-step Runge-Kutta), `simulate` (commands
in, records out), `sensors`, `controller`, `excitation` and `cases` (folders in the recording
format).
"""
