"""Descriptions of attackers end in one sentence after little work: document types, includes by number and by size."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from bad_input import BOMB

import signid
from signid.cli import run
from signid.errors import RobotError
from signid.robot import xacro_strict

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ENTITY = f'<!DOCTYPE r [<!ENTITY a "x">]>{HEAD}<link name="&a;"/></robot>'
SECONDS = 15  # of any refusal here, on a busy machine; an expansion may take sandbox.MAX_SECONDS


def refused(path: Path, says: str) -> None:
    begun = time.process_time()
    with pytest.raises(RobotError, match=says) as caught:
        signid.load_robot(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    assert time.process_time() - begun < SECONDS


@pytest.mark.parametrize("content", [ENTITY, BOMB, f"<!DOCTYPE r SYSTEM 'x.dtd'>{HEAD}</robot>"])
def test_document_types_of_included_xacro_files_are_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "part.xacro").write_text(content)
    for part in ('<xacro:include filename="part.xacro"/>', '<xacro:include filename="p*.xacro"/>'):
        (tmp_path / "r.xacro").write_text(f"{HEAD}{part}</robot>")
        refused(tmp_path / "r.xacro", "included file part.xacro: the file declares a document type")
    inside = f'<xacro:macro name="m">{part}</xacro:macro><xacro:m/>'
    (tmp_path / "r.xacro").write_text(f"{HEAD}{inside}</robot>")
    refused(tmp_path / "r.xacro", "^r.xacro: included file part.xacro: the file declares a document type")


def includes(number: int, tag: str, name: str) -> str:
    return f'<{tag} file{"name" if "xacro" in tag else ""}="{name}"/>' * number


def test_includes_are_limited_by_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "part.xacro").write_text(f"{HEAD}</robot>")
    (tmp_path / "part.xml").write_text("<mujocoinclude><default/></mujocoinclude>")
    (tmp_path / "r.xacro").write_text(f"{HEAD}{includes(5000, 'xacro:include', 'part.xacro')}</robot>")
    (tmp_path / "r.xml").write_text(f"<mujoco>{includes(5000, 'include', 'part.xml')}</mujoco>")
    for name in ("r.xacro", "r.xml"):
        refused(tmp_path / name, "includes more than 500 files; give the description of one robot")
        assert run(["inspect", str(tmp_path / name)]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_thousands_of_files_and_doubling_includes_are_limited(tmp_path: Path) -> None:
    for k in range(2000):
        (tmp_path / f"p{k}.xacro").write_text(f"{HEAD}</robot>")
    (tmp_path / "r.xacro").write_text(f'{HEAD}<xacro:include filename="p*.xacro"/></robot>')
    refused(tmp_path / "r.xacro", "more than 500 files")
    for k in range(10):
        (tmp_path / f"p{k}.xacro").write_text(f"{HEAD}{includes(10, 'xacro:include', f'p{k + 1}.xacro')}</robot>")
        (tmp_path / f"s{k}.xml").write_text(
            f"<mujocoinclude>{includes(10, 'include', f's{k + 1}.xml')}</mujocoinclude>"
        )
    (tmp_path / "s10.xml").write_text("<mujocoinclude/>")
    (tmp_path / "r.xacro").write_text(f"{HEAD}{includes(1, 'xacro:include', 'p0.xacro')}</robot>")
    (tmp_path / "r.xml").write_text(f"<mujoco>{includes(1, 'include', 's0.xml')}</mujoco>")
    refused(tmp_path / "r.xacro", "more than 500 files")
    refused(tmp_path / "r.xml", "more than 500 files")


def test_files_that_include_themselves_or_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "r.xacro").write_text(f"{HEAD}{includes(1, 'xacro:include', 'r.xacro')}</robot>")
    refused(tmp_path / "r.xacro", "r.xacro is included more than 20 files deep")
    (tmp_path / "folder.xacro").mkdir()
    (tmp_path / "r.xacro").write_text(f"{HEAD}{includes(1, 'xacro:include', 'folder.xacro')}</robot>")
    refused(tmp_path / "r.xacro", "folder.xacro: it is no regular file")


def test_optional_includes_may_be_absent(tmp_path: Path) -> None:
    whole = signid.load_robot("1r").document.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    optional = '<xacro:include filename="none.xacro" optional="true"/></robot>'
    (tmp_path / "r.xacro").write_text(whole.replace("</robot>", optional))
    assert signid.load_robot(tmp_path / "r.xacro").joints == ("joint_1",)


def test_the_size_of_all_included_files_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import xacro

    monkeypatch.setattr(xacro, "filestack", [None])
    monkeypatch.setattr(xacro_strict, "MAX_INCLUDED_LETTERS", 1000)
    (tmp_path / "part.xacro").write_text(f"{HEAD}{' ' * 400}</robot>")
    parse = xacro_strict.strict_parser(xacro_strict.Arguments({}))
    assert parse(None, str(tmp_path / "part.xacro")) and parse(None, str(tmp_path / "part.xacro"))
    with pytest.raises(xacro_strict.Sentence, match="more than 0 MB"):
        parse(None, str(tmp_path / "part.xacro"))


def test_usd_is_out_of_scope(tmp_path: Path) -> None:
    for ending in ("usd", "usda", "USDZ"):
        (tmp_path / f"r.{ending}").write_text("#usda 1.0")
        refused(tmp_path / f"r.{ending}", "USD is out of scope; give the URDF, xacro or MJCF file of the robot")
