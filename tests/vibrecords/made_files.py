"""Files made by hand, field by field, as their formats describe them: universal, MATLAB 4 and LabVIEW files."""

import io
import struct

import nptdms
import numpy as np

AXES = {"frequency": 18, "time": 17, "acceleration": 12, "velocity": 11, "displacement": 8, "force": 13, "none": 0}
AXES |= {"excitation": 9}  # a force as well


def header_164(length=1.0, force=1.0, code=1, name="SI"):
    row = "".join(f"{x:25.17E}".replace("E", "D") for x in (length, force, 1.0))
    return f"    -1\n   164\n{code:10d}{name:<20}{2:10d}\n{row}\n{273.15:25.17E}\n    -1\n".replace("E", "D")


def function_58(
    ordinate,
    abscissa=None,
    *,
    first=1.0,
    step=0.5,
    function=4,
    response=("NONE", 12, 3),
    reference=("NONE", 11, 2),
    single=False,
    kinds=("frequency", "acceleration", "force"),
    units=("Hz", "m/s^2", "N"),
    ids=("NONE",) * 5,
    count=None,
    x_width=13,
):
    """Text of one data set 58, as the format describes it, columns and all."""
    ordinate = np.asarray(ordinate)
    complex_ = np.iscomplexobj(ordinate)
    ordinate_type = {(False, True): 2, (False, False): 4, (True, True): 5, (True, False): 6}[complex_, single]
    lines = ["    -1", f"{58:6d}", *ids]
    ends = " ".join(f"{e:<10}{n:10d}{d:4d}" for e, n, d in (response, reference))
    lines.append(f"{function:5d}{0:10d}{0:5d}{0:10d} {ends}")
    even = abscissa is None
    lines.append(
        f"{ordinate_type:10d}{count or ordinate.size:10d}{int(even):10d}"
        f"{first if even else 0:13.5E}{step if even else 0:13.5E}{0:13.5E}"
    )
    for kind, unit in zip((*kinds, "none"), (*units, "NONE"), strict=True):
        lines.append(f"{AXES[kind]:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit:<20}")
    numbers = ordinate.astype(complex).view(float).reshape(-1, 2)[:, : 2 if complex_ else 1]
    columns = numbers if even else np.column_stack([abscissa, numbers])
    wide = "{:13.5E}" if single else "{:20.12E}"
    forms = [wide] * columns.shape[1] if even else [f"{{:{x_width}.5E}}", *[wide] * (columns.shape[1] - 1)]
    cells = [form.format(x) for row in columns for form, x in zip(forms, row, strict=True)]
    per_line = 6 if single else (3 if not even and complex_ else 4)
    lines += ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]
    return "\n".join([*lines, "    -1"]) + "\n"


def binary_58(ordinate, order="<", *, newline="\n", tail=b"", **how):
    """The same in binary; `tail` stands between the values and the delimiter."""
    values = np.asarray(ordinate)
    head = function_58(values, **how).split("\n")[:13]
    wide = 4 if how.get("single") else 8
    body = values.astype(complex if np.iscomplexobj(values) else float).view(float).astype(f"{order}f{wide}").tobytes()
    head[1] = f"{58:6d}b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{len(body):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    return newline.join([*head, ""]).encode() + body + tail + f"    -1{newline}".encode()


def mode_55(shape, stated=(52.5, 2.0, 0.012, 0.0), *, analysis=2, number=3, ids=("NONE",) * 5, per_node=3, counts=None):
    """Text of one data set 55, as the format describes it: `shape` has a row of values for each node's number."""
    rows = {node: np.asarray(row) for node, row in shape.items()}
    complex_ = any(np.iscomplexobj(row) for row in rows.values())
    lines = ["    -1", f"{55:6d}", *ids]
    definition = (1, analysis, {3: 2, 6: 3}[per_node], 8, 5 if complex_ else 2, per_node)
    lines += ["".join(f"{x:10d}" for x in some) for some in (definition, counts or (2, len(stated), 1, number))]
    for numbers, node in ((np.array(stated), None), *((row, node) for node, row in rows.items())):
        lines += [f"{node:10d}"] if node is not None else []
        numbers = numbers.astype(complex).view(float) if complex_ and node is not None else numbers
        cells = [f"{x:13.5E}" for x in numbers]
        lines += ["".join(cells[i : i + 6]) for i in range(0, len(cells), 6)]
    return "\n".join([*lines, "    -1"]) + "\n"


# ---- MATLAB and LabVIEW


def matlab_4(order="<", kind=0, **arrays):
    """Matrices as the description of level 4 has them: type, rows, columns, imaginary part or none, name, columns."""
    letters = ["f8", "f4", "i4", "i2", "u2", "u1"]
    content = b""
    for name, value in arrays.items():
        text = isinstance(value, str)
        array = np.array([list(map(ord, value))]) if text else np.atleast_2d(np.asarray(value).T).T
        mopt = 1000 * (order == ">") + 10 * kind + text
        content += struct.pack(f"{order}5i", mopt, *array.shape, np.iscomplexobj(array), len(name) + 1)
        content += name.encode() + b"\0"
        for part in (array.real, array.imag)[: 1 + np.iscomplexobj(array)]:
            content += part.astype(f"{order}{letters[kind]}").tobytes("F")
    return content


STEP = 1 / 2048


def lvm(names, columns, header, *, layout="One", separator="Tab", stated=True):
    """A file in National Instruments' specification for the LabVIEW measurement file, of one segment."""
    sep, multi, n = {"Tab": "\t", "Comma": ","}[separator], layout == "Multi", len(names)
    about = {"LabVIEW Measurement": "", "Writer_Version": "2" if stated else "0.92", "Separator": separator}
    about |= {"Decimal_Separator": "."} if stated else {}
    about |= {"X_Columns": layout, "Date": "2026/02/03", "Time": "09:51:39.19705", "***End_of_Header***": ""}
    lines = [*(f"{key}{sep}{value}" for key, value in about.items()), sep, f"Channels{sep}{n}" + sep * n]
    for key, values in header.items():
        cells = [cell for value in values for cell in (value, "")] if multi else values
        lines.append(sep.join(map(str, [key, *cells])) + sep)
    lines.append("***End_of_Header***" + sep * (n + 1))
    axes = [cell for name in names for cell in ("X_Value", name)] if multi else ["X_Value", *names]
    lines.append(sep.join([*axes, "Comment"]))
    for i in range(max(map(len, columns))):
        lines.append(sep.join("" if i >= len(c) or c[i] is None else repr(float(c[i])) for c in columns))
    return "\n".join(lines) + "\n"


def head(units, samples=16, x0=0.0, step=STEP, dimension="Time"):
    """Header of a segment; samples and step are the same of all channels, or one for each."""
    n = len(units)
    return {
        "Samples": np.broadcast_to(samples, n).tolist(),
        "Y_Unit_Label": units,
        "X_Dimension": [dimension] * n,
        "X0": [f"{x0:.16E}"] * n,
        "Delta_X": [f"{x:.10E}" for x in np.broadcast_to(step, n).tolist()],
    }


def tdms(groups):
    file = io.BytesIO()
    with nptdms.TdmsWriter(file) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject(group, name, np.asarray(values), properties=told)
                for group, channels in groups.items()
                for name, values, told in channels
            ]
        )
    return file.getvalue()


def clock(unit="", step=STEP, **more):
    return {"wf_increment": step, "wf_start_offset": 0.0, "unit_string": unit} | more
