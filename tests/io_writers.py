"""Files of samples, each written by the library of its format."""

import gc
import struct
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO

import h5py
import numpy as np
import scipy.io

RATE = 1000.0
Columns = Mapping[str, tuple[np.ndarray, str]]


def write_table(
    path: str | Path | IO[str],
    names: str,
    *columns: np.ndarray,
    separator: str = ",",
    fmt: str | Sequence[str] = "%.18e",
) -> None:
    """Write columns, or tables of several, under their names as text."""
    np.savetxt(path, np.column_stack(columns), fmt, separator, header=names, comments="")


def write_csv(path: Path, columns: Columns) -> None:
    rows = zip(*(values.tolist() for values, _ in columns.values()), strict=True)
    text = [",".join(f"{name} [{unit}]" for name, (_, unit) in columns.items())]
    path.write_text("\n".join([*text, *(",".join(map(repr, row)) for row in rows)]) + "\n")


def write_lvm(path: Path, columns: Columns) -> None:
    """Write a LabVIEW measurement file without a column of times."""
    count = len(next(iter(columns.values()))[0])
    names = list(columns)
    every = "\t".join(["{}"] * len(names))
    header = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "Multi_Headings\tNo",
        "X_Columns\tNo",
        "Time_Pref\tAbsolute",
        "Operator\tsomebody",
        "Date\t2026/03/11",
        "Time\t14:02:11.5",
        "***End_of_Header***\t",
        "\t",
        f"Channels\t{len(names)}\t" + "\t" * len(names),
        "Samples\t" + every.format(*[count] * len(names)) + "\t",
        "Date\t" + every.format(*["2026/03/11"] * len(names)) + "\t",
        "Time\t" + every.format(*["14:02:11.5"] * len(names)) + "\t",
        "Y_Unit_Label\t" + every.format(*[unit for _, unit in columns.values()]) + "\t",
        "X_Dimension\t" + every.format(*["Time"] * len(names)) + "\t",
        "X0\t" + every.format(*["0.0000000000000000E+0"] * len(names)) + "\t",
        "Delta_X\t" + every.format(*[f"{1 / RATE:.6f}"] * len(names)) + "\t",
        "***End_of_Header***\t" + "\t" * len(names),
        "X_Value\t" + every.format(*names) + "\tComment",
    ]
    rows = zip(*(values.tolist() for values, _ in columns.values()), strict=True)
    body = ["\t" + "\t".join(map(repr, row)) for row in rows]
    path.write_text("\r\n".join([*header, *body]) + "\r\n")


def write_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as data:
        for name, (values, unit) in columns.items():
            data[name] = values
            data[name].attrs["units"] = unit
        data.attrs["sample_rate"] = RATE


def write_mat5(path: Path, columns: Columns) -> None:
    scipy.io.savemat(path, {name: values[:, None] for name, (values, _) in columns.items()})


def element(kind: int, content: bytes, order: str = "<") -> bytes:
    """Return an element of a MAT file of version 5, filled up to eight bytes."""
    return struct.pack(order + "II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix_of(
    name: bytes, shape: tuple[int, ...], body: bytes, kind: int = 6, order: str = "<"
) -> bytes:
    """Return a matrix of version 5, its content as given."""
    head = element(6, struct.pack(order + "II", kind, 0), order)
    head += element(5, struct.pack(f"{order}{len(shape)}i", *shape), order)
    return element(14, head + element(1, name, order) + body, order)


def mat5(*elements: bytes, order: str = "<") -> bytes:
    """Return a MAT file of version 5 of such elements."""
    version = struct.pack(order + "HH", 256, 0x4D49)
    return b"MATLAB 5.0 MAT-file".ljust(124) + version + b"".join(elements)


def write_mat73(path: Path, columns: Columns) -> None:
    """Write what `save -v7.3` of MATLAB does: HDF5 behind 512 bytes, every matrix transposed."""
    with h5py.File(path, "w", userblock_size=512) as data:
        for name, (values, _) in columns.items():
            data[name] = values[None, :]
            data[name].attrs["MATLAB_class"] = np.bytes_("double")
        data["log/all"] = np.stack([values for values, _ in columns.values()])
        data["label"] = np.frombuffer("run 7".encode("utf-16-le"), dtype=np.uint16)[None, :]
        data["label"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_parquet(path: Path, columns: Columns) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [pa.field(n, pa.float64(), metadata={"unit": u}) for n, (_, u) in columns.items()]
    arrays = [pa.array(values) for values, _ in columns.values()]
    pq.write_table(pa.table(arrays, schema=pa.schema(fields)), path, row_group_size=1000)


def write_tdms(path: Path, columns: Columns) -> None:
    from nptdms import ChannelObject, TdmsWriter

    step = {"wf_increment": 1 / RATE}
    with TdmsWriter(path) as writer:
        for part in range(2):  # two segments, as a logger appends them
            segment = [
                ChannelObject("run", n, np.array_split(v, 2)[part], {"unit_string": u} | step)
                for n, (v, u) in columns.items()
            ]
            writer.write_segment(segment)


def uff_set(name: str, values: np.ndarray, unit: str, *, node: int, binary: int) -> dict:
    """Return a data set 58 of a time response."""
    blank = {"spec_data_type": 0, "len_unit_exp": 0, "force_unit_exp": 0, "temp_unit_exp": 0}
    axes = {"axis_lab": "NONE", "axis_units_lab": "NONE"}
    found: dict = {"type": 58, "binary": binary, "func_type": 1, "id1": name}
    found |= {f"id{i}": "NONE" for i in range(2, 6)}
    found |= {"rsp_node": node, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0, "ver_num": 0}
    found |= {"rsp_ent_name": "NONE", "ref_ent_name": "NONE", "load_case_id": 0}
    for axis in ("abscissa", "ordinate", "orddenom", "z_axis"):
        found |= {f"{axis}_{key}": value for key, value in (blank | axes).items()}
    found |= {"abscissa_spec_data_type": 17, "abscissa_spacing": 1, "abscissa_inc": 1 / RATE}
    found |= {"abscissa_min": 0.0, "z_axis_value": 0.0, "ord_data_type": 4}
    found |= {"x": np.arange(len(values)) / RATE, "data": values, "num_pts": len(values)}
    return found | {"ordinate_axis_units_lab": unit}


def write_sets(path: Path, sets: list[dict]) -> None:
    import pyuff

    path.unlink(missing_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff does not close what it appends to
        pyuff.UFF(str(path)).write_sets(sets, "add")
        gc.collect()


def write_uff(path: Path, columns: Columns, binary: int = 0, named: bool = True) -> None:
    sets = [
        uff_set(name if named else "NONE", values, unit, node=node, binary=binary)
        for node, (name, (values, unit)) in enumerate(columns.items(), start=1)
    ]
    write_sets(path, sets)


def write_mdf(path: Path, columns: Columns) -> None:
    from asammdf import MDF, Signal

    time = np.arange(len(next(iter(columns.values()))[0])) / RATE
    with MDF(version="4.10") as data:
        data.append([Signal(v, time, name=n, unit=u) for n, (v, u) in columns.items()])
        data.save(path, overwrite=True)


WRITERS: Mapping[str, Callable[[Path, Columns], None]] = {
    "run.csv": write_csv,
    "run.lvm": write_lvm,
    "run.h5": write_hdf5,
    "run-v5.mat": write_mat5,
    "run-v73.mat": write_mat73,
    "run.parquet": write_parquet,
    "run.tdms": write_tdms,
    "run.uff": write_uff,
    "run-binary.uff": lambda path, columns: write_uff(path, columns, binary=1),
    "run.mf4": write_mdf,
}
PACKAGES = {".parquet": "pyarrow", ".tdms": "nptdms", ".uff": "pyuff", ".mf4": "asammdf"}


def write_responses(path: Path, sets: list[dict], binary: int = 0) -> None:
    """Write frequency responses and coherences as data sets 58.

    A set holds node and direction of response and force, frequency, values, and, of a response,
    its quantity (8 displacement, 11 velocity, 12 acceleration) and unit.
    """
    written = []
    for given in sets:
        coherent = "unit" not in given
        one = uff_set("NONE", given["values"], given.get("unit", "NONE"), node=0, binary=binary)
        one |= {"func_type": 6 if coherent else 4, "abscissa_spec_data_type": 18}
        one |= {"rsp_node": given["response"][0], "rsp_dir": given["response"][1]}
        one |= {"ref_node": given["force"][0], "ref_dir": given["force"][1]}
        first, second = map(float, given["frequency"][:2])
        one |= {"x": given["frequency"], "num_pts": len(given["frequency"])}
        one |= {"abscissa_min": first, "abscissa_inc": second - first}
        one |= {"ordinate_spec_data_type": given.get("quantity", 0)}
        one |= {"ord_data_type": 4 if coherent else 6}
        one |= {"orddenom_spec_data_type": 0 if coherent else 13}
        one |= {"orddenom_axis_units_lab": "NONE" if coherent else "N"}
        written.append(one)
    write_sets(path, written)
