"""A second simulator for plants that the workbench has never seen, with concealed effects.

Four machines as a newcomer meets them: a two-mass drive, an electric oscillator with a coil, a
heated tank and a crane. Their `truths` stand on laws, an integrator, sensors and actuators of their
own (`machine`); they know nothing of the workbench's language, physics or plants. `newcomer` holds
a first model of each. `foreign_case` draws the cases, diagnoses and judges them.
"""
