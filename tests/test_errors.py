"""Every error is of the package's own family, with the value received, the place and the remedy."""

import ast
import re
from pathlib import Path

import pytest

import preisach_jax
from preisach_jax import errors
from preisach_jax.errors import ContentError, InputError

PACKAGE = Path(preisach_jax.__file__).parent

# What is no message: the end of the process, of a job, of a name that Python looks up.
CONTROL = {"SystemExit", "KeyboardInterrupt", "typer.Exit", "AttributeError"}
# States that the package's own code excludes; no user's input reaches them.
INTERNAL = {
    "diagnosis.excitation": "AssertionError",
    "paper.numbers": "NotImplementedError",
    "model.schema": "PydanticCustomError",
    "export.compiler": "RuntimeError",
}
# What these functions return is raised; their own messages are among those that are walked over.
MAKERS = {
    "_bomb", "_missing", "_no_such_column", "not_readable", "refusal", "too_much", "unfinished",
}  # fmt: skip

REMEDY = re.compile(
    r"""(?ix)
    \b(add|ask|begin|call|change|check|choose|compare|complete|compute|convert|copy|correct|cut|
       declare|define|delete|derive|did\ you\ mean|drop|enter|export|fill|finish|fit|give|have|hold|
       identify|install|keep|leave|let|limit|load|lower|make|measure|mend|move|name|narrow|open|
       pass|put|read|record|remove|rename|repeat|replace|run|save|say|see|set|simulate|sort|split|
       start|store|take|train|try|unpack|update|use|wait|widen|write)\b
    | \bmust\b | \bexpected\b
    | \{(remedy|hint|_AGAIN|_REMEDY|error|said.*|rest|_none_found.*)\}
    """
)
NOTHING_GIVEN = {  # what is missing is no value
    "there is no wanted course yet; drop its file above",
    "models is empty: give at least one model",
    "records: give input and output of each, as (record.input, record.output)",
    "response has lines that are zero or not finite: leave them out",
}
NOT_THERE = re.compile(r"is not installed|there is no C compiler|JAX computes in float32")


def text_of(node):
    """A message as far as the source shows it, with what is put into it in braces."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return f"{{{ast.unparse(node.value)}}}"
    if isinstance(node, ast.BinOp):
        return text_of(node.left) + text_of(node.right)
    return f"{{{ast.unparse(node)}}}"


def made():
    """Place, class and message of each error that is raised or made, and whether it is raised."""
    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text())):
            given = node.exc if isinstance(node, ast.Raise) else node
            if (
                isinstance(node, ast.Raise)
                and given is not None
                and not isinstance(given, ast.Call)
            ):
                yield module, node.lineno, ast.unparse(given), "", True
            elif isinstance(given, ast.Call):
                text = text_of(given.args[0]) if given.args else ""
                name = ast.unparse(given.func)
                yield module, given.lineno, name, text, isinstance(node, ast.Raise)


def family():
    """Names of the package's own errors."""
    found = {name for name, each in vars(errors).items() if isinstance(each, type)}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                bases = {ast.unparse(base) for base in node.bases}
                if bases & {"InputError", "ContentError", "Exception", "KeyboardInterrupt"}:
                    found.add(node.name)
    return found


OWN = family()
MADE = list(made())
TOLD = {"InputError", "QuestionError", "EffectError", "NotFiniteError"}


def test_every_error_is_of_the_family():
    raised = [each for each in MADE if each[-1]]
    assert len(raised) > 350
    assert issubclass(InputError, ValueError)
    assert not issubclass(ContentError, InputError)
    strange = [
        f"{module}:{line} raises {name}"
        for module, line, name, _, _ in raised
        if name not in OWN | CONTROL | MAKERS and INTERNAL.get(module) != name
    ]
    assert not strange


def test_every_message_names_what_was_received_and_the_remedy():
    messages = [each for each in MADE if each[2] in TOLD]
    assert len(messages) > 300
    lacking = [
        f"{module}:{line} {text!r}"
        for module, line, _, text, _ in messages
        if not REMEDY.search(text)
        or not ("{" in text or text in NOTHING_GIVEN or NOT_THERE.search(text))
    ]
    assert not lacking


@pytest.mark.parametrize("text", ["levels is wrong", "levels is {levels}", "give another number"])
def test_a_message_without_both_would_be_found(text):
    assert not ("{" in text and REMEDY.search(text))
