//! The dataset card: `README.md` with the YAML header that dataset hubs read.

use super::Provenance;
use std::collections::BTreeMap;

/// The card of a dataset with so many pairs per split.
pub fn card(provenance: &Provenance, pairs: &BTreeMap<String, usize>) -> String {
    let total: usize = pairs.values().sum();
    let size = match total {
        0..1_000 => "n<1K",
        1_000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        _ => "100K<n<1M",
    };
    let mut text = format!(
        "---\nlicense: cc-by-4.0\ntags:\n- tactile\n- sim2real\n- robotics\nsize_categories:\n- {size}\nconfigs:\n- config_name: default\n  data_files:\n"
    );
    for split in pairs.keys() {
        text.push_str(&format!("  - split: {split}\n    path: data/{split}/**\n"));
    }
    let real =
        if provenance.real_is_virtual { "made up by the virtual bench" } else { "photographed on the bench" };
    text.push_str(&format!(
        "---\n\n# {plan} on {rig}\n\nPaired tactile images of sensor `{sensor}`: the real side was {real}, the simulated side \
         followed the identical trajectory.\n\n| split | pairs |\n|---|---|\n",
        plan = provenance.plan,
        rig = provenance.rig,
        sensor = provenance.sensor,
    ));
    for (split, count) in pairs {
        text.push_str(&format!("| {split} | {count} |\n"));
    }
    text.push_str(
        "\n```python\nfrom datasets import load_dataset\nds = load_dataset(\"imagefolder\", data_dir=\".\")\n\
         # columns real, sim (8-bit RGB), depth (float32, mm, negative when pressed)\n\
         # and contact_mask (8-bit grey, 255 where the indenter touches)\n```\n\n\
         Frame: origin at the centre of the undeformed contact face; x right, y down, z out of the pad towards the indenter, \
         as seen in the camera's upright image. Lengths in mm, forces in N, angles in degrees.\n\n\
         The truth is in `journal/`; `data/*/metadata.parquet` is rebuilt from it. `dataset.json` holds the rig, plan and sensor files \
         verbatim. `report.html` shows every pair. `twinrig verify` checks every sum.\n",
    );
    text
}
