"""A second simulator for plants that the workbench has never seen, with concealed effects.

Four machines as a newcomer meets them: a two-mass drive, an electric oscillator with a coil, a
heated tank and a crane. Their truths (`drive`, `circuit`, `tank`, `crane`) stand on laws of their
own (`laws`) and on an own integrator with own sensors and actuators (`machine`); they know nothing
of the workbench's language, physics or plants. `plants` holds what a newcomer would write as a
first model of each. `plan` draws the cases, `run` diagnoses and judges them.
"""
