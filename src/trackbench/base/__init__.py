"""Ground floor: types, units, linear algebra, errors, random streams, options, plug-ins and executors.

Texts and values of users come in; typed arrays, checked options, loaded plug-ins or an error in one sentence go out. No
other room is imported here. Read ``types.py`` first.
"""
