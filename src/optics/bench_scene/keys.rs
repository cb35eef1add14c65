//! The keys of a file, so that one that the format does not have is refused by its name.

/// Keys of each part of a file, those with explanations in words included.
const KEYS: [(&str, &[&str]); 8] = [
    (
        "",
        &[
            "name",
            "units",
            "elastomer",
            "box",
            "lights",
            "light_notes",
            "camera",
            "max_scattering_events",
            "plate",
            "metrics",
        ],
    ),
    (
        "elastomer",
        &[
            "nx",
            "ny",
            "x_range",
            "y_range",
            "vertex",
            "triangles",
            "height",
            "cx",
            "cy",
            "R",
            "d",
            "rc",
            "hc",
            "k",
            "normals",
            "bsdf",
            "albedo_const",
            "uv",
            "texture",
        ],
    ),
    ("box", &["x", "y", "z", "faces", "albedo"]),
    (
        "lights",
        &[
            "name",
            "center_mm",
            "normal",
            "u_dir",
            "size_u_mm",
            "v_dir",
            "size_v_mm",
            "rgb255",
            "energy_table",
            "radiance_linear_rgb",
        ],
    ),
    ("camera", &["type", "origin", "look_dir", "up", "right", "hfov_deg", "note", "res", "filter", "output"]),
    ("max_scattering_events", &["A", "B", "note"]),
    ("plate", &["variant", "x", "y", "z", "ior", "bsdf", "note"]),
    ("metrics", &["relRMSE", "exposure", "exposure_value"]),
];

/// What is wrong with the first key that the format does not have.
pub(super) fn unknown_key(file: &serde_json::Value) -> Option<String> {
    KEYS.into_iter().find_map(|(part, known)| {
        let value = if part.is_empty() { file } else { &file[part] };
        let tables = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
        let keys = tables.iter().filter_map(|table| table.as_object()).flat_map(|table| table.keys());
        let key = keys.into_iter().find(|key| !known.contains(&key.as_str()))?;
        let place = if part.is_empty() { "the file".to_owned() } else { format!("\"{part}\"") };
        Some(format!("{place} has an unknown key \"{key}\"; known are {}", known.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Variant, parse};

    #[test]
    fn a_key_that_the_format_does_not_have_is_refused_by_name() {
        let text = include_str!("../../../tests/data/optics/tactile-bench-1.json");
        assert!(parse(text, Variant::B).is_ok());
        for (from, to, place) in [
            ("\"cx\"", "\"cx_mm\"", "\"elastomer\" has an unknown key \"cx_mm\""),
            ("\"units\"", "\"unit\"", "the file has an unknown key \"unit\""),
            ("\"size_u_mm\"", "\"size_u\"", "\"lights\" has an unknown key \"size_u\""),
        ] {
            let told = parse(&text.replacen(from, to, 1), Variant::Ac).unwrap_err().to_string();
            assert!(told.contains(place), "{told}");
        }
    }
}
