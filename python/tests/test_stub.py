"""The type stub of the compiled module names what is in it."""

import ast
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import omniwalk
from omniwalk import _native
from programs import ROOT

TREE = ast.parse((Path(omniwalk.__file__).parent / "_native.pyi").read_text())
DICTIONARIES = {
    node.name: {entry.target.id for entry in node.body if isinstance(entry, ast.AnnAssign)}
    for node in TREE.body
    if isinstance(node, ast.ClassDef) and [ast.unparse(base) for base in node.bases] == ["TypedDict"]
}
"""Keys of dictionaries, by names that only type checkers have."""

Parameters = list[tuple[str, str, bool]]
"""Names of parameters in order, their kinds, and whether they have a default."""


def public(name: str) -> bool:
    return not name.startswith("_")


def stub_parameters(function: ast.FunctionDef) -> Parameters:
    given = function.args
    assert not given.posonlyargs and not given.vararg and not given.kwarg, function.name
    without = len(given.args) - len(given.defaults)
    found = [(each.arg, "POSITIONAL_OR_KEYWORD", place >= without) for place, each in enumerate(given.args)]
    found += [(each.arg, "KEYWORD_ONLY", default is not None) for each, default in zip(given.kwonlyargs, given.kw_defaults)]
    return [each for each in found if each[0] not in ("self", "cls")]


def compiled_parameters(function: Callable[..., Any]) -> Parameters:
    given = inspect.signature(function).parameters.values()
    return [(each.name, each.kind.name, each.default is not each.empty) for each in given if each.name != "self"]


def stub_class(node: ast.ClassDef) -> dict[str, Parameters | None]:
    """Parameters of each member, None for properties; of overloads the one that has them all."""
    found: dict[str, Parameters | None] = {}
    for member in node.body:
        if not isinstance(member, ast.FunctionDef):
            continue
        decorators = [ast.unparse(decorator) for decorator in member.decorator_list]
        if "property" in decorators:
            found[member.name] = None
            continue
        fewer, more = sorted((stub_parameters(member), found.get(member.name) or []), key=len)
        assert not fewer or "overload" in decorators and set(fewer) <= set(more), member.name
        found[member.name] = more
    return found


def compiled_class(found: type) -> dict[str, Parameters | None]:
    members = {
        name: None if inspect.isgetsetdescriptor(member) else compiled_parameters(member)
        for name, member in vars(found).items()
        if public(name)
    }
    # What cannot be called has no constructor; the signature of what can is that of the class.
    return members | ({"__new__": compiled_parameters(found)} if "__new__" in vars(found) else {})


def test_the_stub_has_every_name_of_the_compiled_module_and_no_other():
    stub, compiled = {}, {}
    for node in TREE.body:
        if isinstance(node, ast.FunctionDef):
            stub[node.name] = stub_parameters(node)
        elif isinstance(node, ast.ClassDef) and node.name not in DICTIONARIES:
            stub[node.name] = stub_class(node)
        elif isinstance(node, ast.AnnAssign):
            stub[node.target.id] = None
    for name, found in vars(_native).items():
        if inspect.isclass(found):
            # An exception has what its base has.
            compiled[name] = {} if issubclass(found, Exception) else compiled_class(found)
        elif callable(found) and public(name):
            compiled[name] = compiled_parameters(found)
        elif public(name) or name == "__version__":
            compiled[name] = None
    assert "Controller" in compiled and compiled["Controller"]["__new__"], "what is compared is there"
    assert stub == compiled


def test_golden_vectors_have_the_keys_that_the_stub_names():
    golden = omniwalk.Controller(ROOT / "runs/nimbro_op2x_omni/policy.omni").golden()
    assert golden.keys() == DICTIONARIES["Golden"]
    assert all(step.keys() == DICTIONARIES["GoldenStep"] for step in golden["steps"]) and golden["steps"]
