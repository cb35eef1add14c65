"""Loads a dataset with Hugging Face `datasets` and checks what arrives.

Not part of `cargo test`, because it needs Python: pip install datasets numpy pillow pyarrow, then
    python tests/hf_load.py data/slip
"""

import sys

import numpy
from datasets import load_dataset


def main(folder: str) -> None:
    splits = load_dataset("imagefolder", data_dir=folder)
    rows = 0
    for name, split in splits.items():
        assert split.num_rows > 0, f"split {name} is empty"
        rows += split.num_rows
        row = split[0]
        sides = [column for column in ("real", "sim") if column in split.column_names]
        assert sides, "there is neither a real nor a simulated side"
        for column in sides:
            assert row[column].mode == "RGB", f"{column} has mode {row[column].mode}"
        assert row["capture"] is not None and row["pair_id"], "a row has no identity"
        if "sim" not in sides:
            print(f"{name}: {split.num_rows} rows of the real side alone, {len(split.column_names)} columns")
            continue
        depth = numpy.asarray(row["depth"])
        assert depth.dtype == numpy.float32, f"depth is {depth.dtype}"
        assert numpy.isfinite(depth).all() and depth.min() > -10, "depth is no height in mm"
        contact = numpy.asarray(row["contact_mask"])
        assert row["contact_mask"].mode == "L" and set(numpy.unique(contact)) <= {0, 255}, "the contact is no mask"
        assert contact.shape == depth.shape, "mask and depth differ in size"
        print(f"{name}: {split.num_rows} rows, {len(split.column_names)} columns, depth from {depth.min():.3f} to {depth.max():.3f} mm")
    print(f"{rows} rows in all")


if __name__ == "__main__":
    main(sys.argv[1])
