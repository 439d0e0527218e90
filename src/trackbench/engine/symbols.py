"""Symbols: arrays of nodes that NumPy's functions accept, with which equations are traced."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import prod
from typing import Any, NoReturn

import numpy as np

from trackbench.engine.equations import Values
from trackbench.engine.graph import Graph
from trackbench.engine.nodes import Nodes, cast, is_boolean, nodes_of
from trackbench.engine.numpy_functions import FUNCTIONS


def _method(function: Any) -> Callable[..., Any]:
    return lambda self, *arguments, **options: function(self, *arguments, **options)


class Symbol(np.lib.mixins.NDArrayOperatorsMixin):
    """Array of nodes that behaves like a NumPy array, so that equations called with it are traced."""

    __array_priority__ = 1000
    # A function with a cache may get a symbol as its key.
    __hash__ = object.__hash__

    def __init__(self, graph: Graph, nodes: Nodes) -> None:
        self.graph = graph
        self.nodes = nodes

    @property
    def shape(self) -> tuple[int, ...]:
        return self.nodes.shape

    @property
    def ndim(self) -> int:
        return self.nodes.ndim

    @property
    def size(self) -> int:
        return prod(self.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(bool if is_boolean(self.nodes) else float)

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Symbol]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, key: Any) -> Symbol:
        keys = key if isinstance(key, tuple) else (key,)
        # An ellipsis makes a view of a single entry too, as with batch axes.
        keys = keys if any(item is Ellipsis for item in keys) else (*keys, ...)
        return Symbol(self.graph, self.nodes[keys])

    def __setitem__(self, key: Any, value: Any) -> None:
        nodes = cast(self.graph, nodes_of(self.graph, _unwrap(self.graph, value)), is_boolean(self.nodes))
        self.nodes[key] = nodes if nodes.ndim else nodes[()]

    def __bool__(self) -> NoReturn:
        self.graph.refuse("a branch on a single value; np.where, or np.all or np.any, can be traced")

    def _not_a_number(self, *_: Any, **__: Any) -> NoReturn:
        self.graph.refuse("a number is asked for, where the value is known only later")

    __float__ = __int__ = __index__ = __complex__ = __array__ = item = tolist = _not_a_number

    def __getattr__(self, name: str) -> NoReturn:
        # NumPy looks up some of these to learn what an object can do.
        if name.startswith("__"):
            raise AttributeError(name)
        self.graph.refuse(f"the attribute {name} of an array, which cannot be traced")

    def astype(self, dtype: Any) -> Symbol:
        if np.dtype(dtype) not in (float, bool):
            self.graph.refuse(f"an array of {np.dtype(dtype)}")
        return Symbol(self.graph, cast(self.graph, self.nodes, np.dtype(dtype) == bool).copy())

    def reshape(self, *shape: Any) -> Symbol:
        return Symbol(self.graph, self.nodes.reshape(*shape))

    copy, swapaxes = map(_method, (np.copy, np.swapaxes))
    sum, prod, max, min, all, any = map(_method, (np.sum, np.prod, np.max, np.min, np.all, np.any))

    def __array_ufunc__(self, function: np.ufunc, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        if method != "__call__" or options:
            self.graph.refuse(f"numpy.{function.__name__}.{method} with {', '.join(options) or 'such arguments'}")
        result = self._call(function, inputs, {})
        if out is None:
            return result
        target = out[0]
        if not isinstance(target, Symbol):
            self.graph.refuse("an array that is filled in place")
        if is_boolean(target.nodes) and not is_boolean(result.nodes):
            raise TypeError("numbers cannot be put in place of truth values")
        target.nodes[...] = np.broadcast_to(cast(self.graph, result.nodes, is_boolean(target.nodes)), target.shape)
        return target

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        return self._call(function, arguments, options)

    def _call(self, function: Any, arguments: Any, options: Any) -> Any:
        if function not in FUNCTIONS:
            self.graph.refuse(f"numpy.{function.__name__}, which cannot be traced")
        plain = [_unwrap(self.graph, argument) for argument in arguments]
        chosen = {name: _unwrap(self.graph, value) for name, value in options.items()}
        result = FUNCTIONS[function](self.graph, *plain, **chosen)
        if isinstance(result, tuple) and result and isinstance(result[0], np.ndarray):
            return tuple(Symbol(self.graph, nodes) for nodes in result)
        return Symbol(self.graph, result) if isinstance(result, np.ndarray) else result


def is_traced(values: Values) -> bool:
    """Return whether the values are symbols, so that equations are being traced and not computed."""
    return any(isinstance(value, Symbol) for value in values.values())


def _unwrap(graph: Graph, value: Any) -> Any:
    """Return a value with each symbol in it replaced by its nodes."""
    if isinstance(value, Symbol):
        if value.graph is not graph:
            graph.refuse("a value that was kept from another call")
        return value.nodes
    if isinstance(value, list | tuple):
        return type(value)([_unwrap(graph, item) for item in value]) if type(value) in (list, tuple) else value
    if isinstance(value, np.ndarray) and value.dtype == object:
        graph.refuse("an array of objects")
    return value


def nodes_of_output(graph: Graph, value: Any) -> Nodes:
    """Return an output of a traced function, made of symbols or numbers, as nodes."""
    return nodes_of(graph, _unwrap(graph, value))
