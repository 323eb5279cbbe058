"""Folders with labels, well made and not."""

from pathlib import Path

import pytest

from service.datasets import DatasetError, find_meshes, read_collection


def write(folder: Path, **files: str) -> Path:
    """Files below a folder; in their names, two underscores are a slash and one a dot."""
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def found(*paths: Path, root: Path) -> list[tuple[str, str | None]]:
    return [(str(file.path.relative_to(root)), file.label) for file in find_meshes(paths).files]


def test_labels_file(tmp_path: Path) -> None:
    write(tmp_path, labels_csv="file,class\nb.off,Cup\nsub/a.stl, Bird \n", b_off="", other_off="")
    assert read_collection(tmp_path) == [(tmp_path / "b.off", "Cup"), (tmp_path / "sub/a.stl", "Bird")]


def test_labels_file_as_a_spreadsheet_writes_it(tmp_path: Path) -> None:
    text = '\ufeffclass,note,file\r\n"Cup, small",x,1.off\r\n'
    (tmp_path / "labels.csv").write_bytes(text.encode())
    assert read_collection(tmp_path) == [(tmp_path / "1.off", "Cup, small")]


def test_class_folders_with_folders_in_them(tmp_path: Path) -> None:
    write(
        tmp_path,
        bird__train__a_off="",
        bird__b_OBJ="",
        cup__c_glb="",
        cup__readme_txt="",
        cup___hidden_off="",
    )
    assert found(tmp_path, root=tmp_path) == [
        ("bird/b.OBJ", "bird"),
        ("bird/train/a.off", "bird"),
        ("cup/c.glb", "cup"),
    ]
    assert find_meshes([tmp_path]).ignored == 1


def test_collections_beneath_a_folder_keep_their_labels(tmp_path: Path) -> None:
    write(tmp_path, one__labels_csv="file,class\n1.off,Cup\n", one__1_off="", two__2_off="")
    assert found(tmp_path, root=tmp_path) == [("one/1.off", "Cup"), ("two/2.off", "two")]


def test_named_files_come_once_and_without_class(tmp_path: Path) -> None:
    write(tmp_path, a_off="", b_xyz="", sub__c_off="")
    paths = (tmp_path / "b.xyz", tmp_path / "a.off", tmp_path, tmp_path / "sub/../a.off")
    assert found(*paths[:3], root=tmp_path) == [("b.xyz", None), ("a.off", None), ("sub/c.off", "sub")]
    assert len(find_meshes(paths).files) == 3


def test_a_named_file_has_the_class_that_labels_beside_it_give(tmp_path: Path) -> None:
    write(tmp_path, cup__labels_csv="file,class\n1.off,Mug\n", cup__1_off="", cup__2_off="", bird__3_off="")
    paths = [tmp_path / "cup" / "2.off", tmp_path / "bird" / ".." / "cup" / "1.off", tmp_path / "bird/3.off"]
    assert [file.label for file in find_meshes(paths).files] == [None, "Mug", None]
    write(tmp_path, cup__labels_csv="nothing of use")
    with pytest.raises(DatasetError, match="first line"):
        find_meshes(paths)


def test_a_link_to_a_folder_above_ends(tmp_path: Path) -> None:
    write(tmp_path, cup__a_off="")
    (tmp_path / "cup" / "loop").symlink_to(tmp_path)
    assert found(tmp_path, root=tmp_path) == [("cup/a.off", "cup")]


@pytest.mark.parametrize(
    ("labels", "part"),
    [
        ("", "first line"),
        ("name,class\na.off,Cup\n", "first line"),
        ("file,class\na.off\n", "line 2"),
        ("file,class\na.off,Cup\n,Cup\n", "line 3"),
        ("file,class\na.off,Cup\na.off,Bird\n", "a.off is listed twice"),
        ("file,class\n", "no meshes"),
    ],
)
def test_bad_labels_are_named(tmp_path: Path, labels: str, part: str) -> None:
    write(tmp_path, labels_csv=labels)
    with pytest.raises(DatasetError, match=part):
        read_collection(tmp_path)


def test_labels_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_bytes(b"file,class\n\xff\xfe,x\n")
    with pytest.raises(DatasetError, match=r"labels\.csv"):
        read_collection(tmp_path)


def test_a_collection_needs_a_class_for_every_mesh(tmp_path: Path) -> None:
    write(tmp_path, cup__a_off="", stray_off="")
    with pytest.raises(DatasetError, match=r"stray\.off has no class"):
        read_collection(tmp_path)


def test_a_collection_needs_a_folder_and_meshes(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such folder"):
        read_collection(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match="no meshes"):
        read_collection(tmp_path)
    with pytest.raises(DatasetError, match="no such file"):
        find_meshes([tmp_path / "nothing.off"])
