"""Motion models and sensor models: options of the scenario, and equations as functions on component arrays.

Options come in as checked configuration, states and poses as arrays; states, measurements and Jacobians go out. No
model has a state. Read ``motion/base.py`` first.
"""
