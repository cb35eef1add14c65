//! The page holds what the dataset says, is well formed, and stays small.

use super::*;
use crate::pairing::tests::dataset;
use std::collections::BTreeSet;

/// Every element that is opened is closed, in order.
fn assert_well_formed(html: &str) {
    let body = html.split_once("</style>").unwrap().1;
    let void = BTreeSet::from(["img", "br", "meta", "line", "rect", "circle", "polyline", "polygon", "path"]);
    let mut open: Vec<&str> = vec!["html", "head"];
    for tag in body.split('<').skip(1) {
        let inside = tag.split_once('>').unwrap_or_else(|| panic!("unclosed tag <{tag:.40}")).0;
        let name = inside.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap();
        if inside.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "near <{inside:.60}>");
        } else if !inside.ends_with('/') && !void.contains(name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
}

#[test]
fn the_report_is_one_self_contained_page_with_every_capture() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 10, 0.0);
    let Written { path, numbers } = write(&dataset).unwrap();
    let html = std::fs::read_to_string(&path).unwrap();
    assert_well_formed(&html);
    for capture in 0..10 {
        assert!(html.contains(&format!("#{capture} · sphere")), "capture {capture} is missing");
    }
    assert!(html.contains("The real side is virtual") && html.contains("null predictor"));
    assert!(html.contains("10 / 10"));
    // What scripts read is what the page shows.
    assert_eq!((numbers.planned, numbers.real, numbers.simulated, numbers.compared), (10, 10, 10, 10));
    assert!(numbers.refused.is_empty() && numbers.real_is_virtual);
    let all = |score| {
        numbers.scores.iter().find(|s| s.indenter.is_none() && s.place == "whole" && s.score == score)
    };
    let (psnr, ssim) = (all("psnr_db").unwrap(), all("ssim").unwrap());
    assert_eq!((psnr.captures, ssim.captures), (10, 10));
    for shown in [
        format!("<td>{:.2}</td>", psnr.simulation.unwrap()),
        format!("<td>{:.4}</td>", ssim.simulation.unwrap()),
    ] {
        assert!(html.contains(&shown), "{shown}");
    }
    assert!(numbers.scores.iter().any(|s| s.indenter.as_deref() == Some("sphere") && s.place == "contact"));
    // Nothing is fetched from anywhere: the only address is that of the SVG name space.
    let addresses: BTreeSet<&str> =
        html.match_indices("http").map(|(i, _)| html[i..].split('"').next().unwrap()).collect();
    assert_eq!(addresses, BTreeSet::from(["http://www.w3.org/2000/svg"]));
    // Text and numbers, without the pictures' letters.
    let text: String =
        html.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, t)| t)).collect();
    assert!(!text.contains("#010203") && !text.contains("NaN") && !text.contains("inf "));
    // The tables were rebuilt with the scores.
    assert!(folder.path().join("data/train/metadata.parquet").exists());
    assert!(crate::dataset::verify::verify(folder.path()).unwrap().findings.is_empty());
}

#[test]
fn the_same_dataset_gives_the_same_page() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 4, 0.0);
    let first = std::fs::read(write(&dataset).unwrap().path).unwrap();
    assert_eq!(first, std::fs::read(write(&dataset).unwrap().path).unwrap());
}

#[test]
fn an_empty_dataset_has_a_report_too() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 0, 0.0);
    let html = std::fs::read_to_string(write(&dataset).unwrap().path).unwrap();
    assert_well_formed(&html);
    assert!(html.contains("Nothing was captured"));
}

#[test]
fn a_broken_picture_is_named_and_the_rest_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 3, 0.0);
    std::fs::write(folder.path().join("data/train/sim/000001.png"), b"torn").unwrap();
    let html = std::fs::read_to_string(write(&dataset).unwrap().path).unwrap();
    assert_well_formed(&html);
    assert!(html.contains("Could not be compared") && html.contains("capture 1: "));
    assert!(html.contains("#2 · sphere"));
}
