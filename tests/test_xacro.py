"""xacro files: expressions are walked, not evaluated, in a process that may do nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.sax.saxutils import escape

import pytest
from bad_input import JOINT, LINKS
from toys import refused

import signid
from signid.robot import sandbox
from signid.robot.document import read_document

HERE = Path(__file__).parents[1]
SECRET = "<robot name='secret'/>"
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'


@pytest.mark.parametrize("name", ["../outside.xacro", "ABSOLUTE", "$(find nowhere)/x.xacro"])
def test_xacro_stays_beside_the_description(name: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "outside.xacro").write_text(SECRET)
    name = name.replace("ABSOLUTE", str(tmp_path / "outside.xacro"))
    refused(inside / "r.xacro", f'{HEAD}<xacro:include filename="{name}"/></robot>', "xacro cannot expand it")


def test_xacro_reads_files_beside_it_in_a_package_or_in_allowed_folders(tmp_path: Path) -> None:
    part = f"{HEAD}{LINKS}{JOINT}</robot>"
    for folder in ("é è/deep", "package", "given"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "part.xacro").write_text(part)
    (tmp_path / "package/package.xml").write_text("<package><name>package</name></package>")
    for name, dirs in (("deep/part.xacro", []), ("../package/part.xacro", []), ("../given/part.xacro", ["given"])):
        path = tmp_path / "é è" / "r.xacro"
        path.write_text(f'{HEAD}<xacro:include filename="{name}"/></robot>')
        assert signid.load_robot(path, package_dirs=[tmp_path / x for x in dirs]).joints == ("j",)


ESCAPES = [
    "open('/etc/passwd').read()",
    "__import__('os').getpid()",
    "().__class__.__base__",
    "().__class__.__base__.__subclasses__()",
    "[c for c in ().__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close'][0]",
    "(x for x in ()).gi_frame.f_back.f_builtins",
    "str.mro()",
    "'{0.__class__}'.format(1)",
    "'{0.__class__}'.format_map({})",
    "f'{().__class__}'",
    "python.type(1)",
    "python.vars(math)",
    "python.vars(python.type(1))['__init__']",
    "xacro.tokenize.__globals__",
    "xacro.load_yaml.__globals__['os'].system('touch escaped')",
    "xacro.load_yaml('/etc/passwd')",
    "load_yaml('/etc/passwd')",
    "list(python.map(python.type, [1]))",
    "math.parent",
    "math.__dict__",
    "python['type']",
    "(lambda: 1)()",
    "[y := 1]",
    "str.__add__",
    "getattr(str, 'mro')",
    "str.join.__self__",
    "9**9**9",
    "'a' * 10**11",
    "list(range(10**12))",
    "[x for x in range(10**9)]",
    "'%0999999999999d' % 1",
    "1 << 10**12",
    "(" * 5000 + "1" + ")" * 5000,
]


FORMS = [*(("${", "}", x) for x in ESCAPES), *(("$(eval ", ")", x) for x in ESCAPES[:6])]


@pytest.mark.parametrize(("opening", "closing", "expression"), FORMS, ids=lambda word: word[:50])
def test_xacro_expressions_do_nothing_else(
    opening: str, closing: str, expression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "MAX_SECONDS", 3)
    monkeypatch.chdir(tmp_path)
    name = escape(f"{opening}{expression}{closing}", {'"': "&quot;"})
    refused(tmp_path / "r.xacro", f'{HEAD}<link name="{name}"/></robot>', "xacro cannot expand it")
    assert [path.name for path in tmp_path.iterdir()] == ["r.xacro"]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2*pi/4", "1.57"),
        ("radians(180) + sin(0)", "3.14"),
        ("sizes['a'] + sizes.b", "5"),
        ("[2*x for x in wide if x > 1][0]", "4"),
        ("'big' if len(wide) == 2 and not False else 'small'", "big"),
        ("max(wide) - min(*wide)", "1"),
        ("'a-b'.upper().split('-')[1]", "B"),
        ("xacro.arg('side') + '_' + str(int(2.7))", "left_2"),
        ("wide[0:1] + list(python.sorted(wide, reverse=True))", "[1, 2, 1]"),
        ("dict(a=1).get('b', 7)", "7"),
        ("math.pi == pi", "True"),
        ("python.round(pi, 2)", "3.14"),
        ("-half ** 2", "-0.25"),
    ],
)
def test_xacro_expressions_have_what_xacro_documents(expression: str, value: str, tmp_path: Path) -> None:
    (tmp_path / "sizes.yaml").write_text("{a: 2, b: 3}")
    path, name = tmp_path / "r.xacro", escape(expression, {'"': "&quot;"})
    path.write_text(
        f'{HEAD}<xacro:arg name="side" default="left"/><xacro:property name="half" value="${{1/2}}"/>'
        f'<xacro:property name="sizes" value="${{xacro.load_yaml(\'sizes.yaml\')}}"/>'
        f'<xacro:property name="wide" value="${{[1, 2]}}"/>'
        f'<link name="base"/><link name="v${{{name}}}"/><joint name="j" type="fixed"><parent link="base"/>'
        f'<child link="v${{{name}}}"/></joint><link name="k"/><joint name="m" type="continuous">'
        '<parent link="base"/><child link="k"/><axis xyz="0 $(eval side == \'left\' and 1) 0"/></joint></robot>'
    )
    text = read_document(path).text
    assert f'<link name="v{value}' in text and '"0 1 0"' in text


def test_the_process_may_neither_write_nor_run_nor_connect(tmp_path: Path) -> None:
    program = f"""if 1:
        import os, socket, subprocess
        from signid.robot import sandbox
        sandbox._guard([{str(tmp_path / "inside")!r}])
        def refused(act, *given):
            try:
                act(*given)
            except PermissionError:
                return True
        assert not refused(open, {str(tmp_path / "inside/r.xacro")!r}), "read"
        assert refused(open, {str(tmp_path / "secret")!r}), "read outside"
        assert refused(open, {str(tmp_path / "inside/w")!r}, "w"), "write"
        assert refused(os.open, {str(tmp_path / "inside/w")!r}, os.O_CREAT | os.O_RDWR), "write"
        assert refused(os.remove, {str(tmp_path / "secret")!r}), "remove"
        assert refused(subprocess.run, ["/bin/sh", "-c", "exit"]), "run"
        assert refused(os.system, "exit"), "run"
        assert refused(socket.create_connection, ("127.0.0.1", 9)), "connect"
    """
    (tmp_path / "inside").mkdir()
    for name in ("inside/r.xacro", "secret"):
        (tmp_path / name).touch()
    there = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run([sys.executable, "-c", program], env=there, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "secret").exists() and not (tmp_path / "inside/w").exists()


@pytest.mark.slow
def test_macros_without_end_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "MAX_SECONDS", 3)
    names = "abcdefghijklmnopqrstuvwxyz"
    macros = "".join(
        f'<xacro:macro name="{x}"><xacro:{y}/><xacro:{y}/></xacro:macro>'
        for x, y in zip(names, names[1:], strict=False)
    )
    text = f'{HEAD}{macros}<xacro:macro name="z"><link name="l"/></xacro:macro><xacro:a/></robot>'
    refused(tmp_path / "r.xacro", text, "xacro cannot expand it")


def test_xacro_keeps_to_limits_that_are_there_already() -> None:
    pytest.importorskip("resource")
    program = """if 1:
        import resource
        from signid.robot import sandbox
        resource.setrlimit(resource.RLIMIT_AS, (3_000_000_000,) * 2)
        sandbox._limit_process()
        assert resource.getrlimit(resource.RLIMIT_AS) == (3_000_000_000,) * 2
        assert resource.getrlimit(resource.RLIMIT_CPU)[0] == sandbox.MAX_SECONDS
    """
    there = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run([sys.executable, "-c", program], env=there, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
