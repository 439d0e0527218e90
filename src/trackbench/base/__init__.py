"""The ground floor: types, units, linear algebra, errors, random streams, options, plug-ins, executors."""
