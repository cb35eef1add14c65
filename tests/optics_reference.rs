//! The reference renderer against numbers of others: the benchmark scene's converged block means.

use std::path::Path;
use twinrig::optics::{Film, bench_scene, bench_scene::Variant, reference};

fn data(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/optics").join(name)
}

/// Block means over 20 x 20 pixels of the converged 640x480 reference (agreed with Cycles and Mitsuba to 0.1 %).
fn block_means() -> Film {
    let path = data("ref_Ac_block_means_20x20.npy");
    Film::from_npy(&std::fs::read(path).unwrap(), "block means").unwrap()
}

#[test]
fn block_means_of_the_benchmark_scene_agree_with_the_converged_reference() {
    let mut scene = bench_scene::load(&data("tactile-bench-1.json"), Variant::Ac).unwrap();
    scene.camera = scene.camera.with_raster(160, 120);
    let renderer = reference::Renderer::new(&scene).unwrap();
    let picture = renderer.render(&reference::Settings { samples: 32, seed: 1 });
    let truth = block_means();
    let mut blocks = Film::new(32, 24);
    for (k, p) in picture.pixels.iter().enumerate() {
        let (x, y) = (k % 160, k / 160);
        blocks.pixels[(y / 5) * 32 + x / 5] += *p / 25.0;
    }
    // 25 pixels of 32 samples a block: the measured standard error is 0.7 % of the mean.
    let error = blocks.relative_rmse(&truth);
    assert!(error < 0.01, "block relRMSE {error}");
    for c in 0..3 {
        let ratio = blocks.mean()[c] / truth.mean()[c];
        assert!((ratio - 1.0).abs() < 0.001, "channel {c}: mean off by {ratio}");
    }
}
