//! Every shipped sensor file is loaded, checked and seen.

use serde::Deserialize;
use std::path::{Path, PathBuf};
use twinrig::elastomer;
use twinrig::optics::sensor::{HousingSpec, LightShapeSpec};
use twinrig::optics::{DisplacedSurface, SensorOptics, imager, reference};
use twinrig::problem::{Problem, Problems};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    schema: u32,
    name: String,
    pad: elastomer::Pad,
    optics: SensorOptics,
    untouched: Option<PathBuf>,
}

/// Every shipped sensor file.
fn shipped() -> impl Iterator<Item = PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs/sensors");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|e| e == "toml"))
}

#[test]
fn shipped_sensors_load_pass_their_checks_and_see_all_of_their_pad() {
    let mut seen = 0;
    for path in shipped() {
        let file: SensorFile = toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        assert_eq!(file.schema, 1);
        assert_eq!(Some(file.name.as_str()), path.file_stem().and_then(|s| s.to_str()));
        let mut problems = Problems::new();
        file.optics.check(&mut problems);
        assert_eq!(problems.into_vec(), Vec::new(), "{}", path.display());
        if let Some(untouched) = &file.untouched {
            let bytes = std::fs::read(path.with_file_name(untouched)).unwrap();
            let picture = twinrig::image::png::decode(&bytes).unwrap();
            let camera = &file.optics.camera;
            assert_eq!(
                [picture.width as usize, picture.height as usize],
                [camera.width_px, camera.height_px]
            );
        }

        // A small raster of the same view.
        let mut optics = file.optics;
        optics.camera.width_px /= 10;
        optics.camera.height_px /= 10;
        optics.camera.mm_per_px *= 10.0;
        optics.mesh.vertices = [0, 0];
        let size = [file.pad.size_x_mm, file.pad.size_y_mm];
        let rest = match file.pad.shape {
            elastomer::PadShape::Dome { radius_mm: r } => {
                DisplacedSurface::resting(81, 81, size, |x, y| (r * r - x * x - y * y).max(0.0).sqrt() - r)
            }
            _ => DisplacedSurface::flat(41, 41, size),
        };
        let settings = reference::Settings { samples: 8, seed: 0 };
        let picture = imager::Imager::new(&optics, settings, None, &rest).unwrap().picture(&rest, 0).unwrap();
        assert!(picture.depth_mm.iter().all(|z| z.is_finite()), "{} sees past its pad", path.display());
        assert!(picture.rgb.iter().all(|&c| c > 20), "{} is dark somewhere", path.display());
        seen += 1;
    }
    assert!(seen >= 5);
}

/// Over the mesh that each has by default, in a small picture.
#[test]
fn shipped_sensors_are_rendered_by_the_fast_mode_and_meet_the_tolerance() {
    let out = tempfile::tempdir().unwrap();
    for path in shipped() {
        let render = std::process::Command::new(env!("CARGO_BIN_EXE_twinrig"))
            .args(["render", "--mode", "fast", "--size", "120x120", "--json", "--out"])
            .args([&out.path().join("picture.npy"), &path])
            .env("TWINRIG_CACHE", "")
            .output()
            .unwrap();
        assert!(render.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&render.stderr));
        let told: serde_json::Value = serde_json::from_slice(&render.stdout).unwrap();
        assert_eq!(told["meets_tolerance"], true, "{}: {told}", path.display());
    }
}

/// A coarser mesh would take some points and leave others out: a sharp rim that runs aslant turns into beads.
#[test]
fn shipped_meshes_are_as_fine_as_the_face_that_the_elastomer_gives() {
    let points = elastomer::Settings::default().surface;
    for path in shipped() {
        let file: SensorFile = toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let vertices = file.optics.mesh_vertices([file.pad.size_x_mm, file.pad.size_y_mm]);
        assert!(vertices[0] >= points[0] && vertices[1] >= points[1], "{}: {vertices:?}", path.display());
    }
}

#[test]
fn a_typo_and_a_light_outside_are_told_with_their_keys() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs/sensors/gelsight.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let typo = toml::from_str::<SensorFile>(&text.replace("mm_per_px", "mm_per_pixel"));
    assert!(typo.err().unwrap().to_string().contains("mm_per_pixel"));
    let bad = text.replace("[-21.999, 0.0, -5.0]", "[-21.999, 0.0, 5.0]").replace("0.028125", "0.1");
    let file: SensorFile = toml::from_str(&bad).unwrap();
    let mut problems = Problems::new();
    file.optics.check(&mut problems);
    let keys: Vec<String> = problems.into_vec().into_iter().map(|p| p.key).collect();
    assert_eq!(keys, ["housing.x_mm", "housing.y_mm", "lights[0].shape.center_mm"]);
}

/// What is wrong with the shipped GelSight after a change.
fn told(change: impl Fn(&mut SensorOptics)) -> Vec<Problem> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs/sensors/gelsight.toml");
    let mut file: SensorFile = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    change(&mut file.optics);
    let mut problems = Problems::new();
    file.optics.check(&mut problems);
    problems.into_vec()
}

#[test]
fn a_light_that_shines_into_the_wall_at_its_back_is_told_how_to_turn() {
    let blue = |center_mm: [f64; 3], facing: [f64; 3]| {
        let of_kind = |is_disc: bool| {
            told(|optics| {
                optics.lights[0].shape = match is_disc {
                    true => LightShapeSpec::Disc { center_mm, facing, radius_mm: 1.0 },
                    false => LightShapeSpec::Rectangle { center_mm, facing, size_mm: [24.0, 2.0] },
                }
            })
        };
        let [disc, rectangle] = [true, false].map(of_kind);
        assert_eq!(disc, rectangle);
        disc
    };
    let turned = blue([-21.999, 0.0, -5.0], [-2.0, 0.0, 0.5]);
    assert_eq!(turned.len(), 1, "{turned:?}");
    let Problem { key, value, allowed, next } = &turned[0];
    assert_eq!((key.as_str(), value.as_str()), ("lights[0].shape.facing", "[-2.0, 0.0, 0.5]"));
    assert!(allowed.contains("\"blue\"") && allowed.contains("0.001 mm"), "{allowed}");
    assert_eq!(next, "turn it: facing = [2.0, 0.0, 0.5]");
    for (center_mm, facing) in [
        ([21.999, 0.0, -5.0], [1.0, 0.0, 0.0]),
        ([0.0, -21.999, -5.0], [0.0, -1.0, 0.0]),
        ([0.0, 21.999, -5.0], [0.0, 1.0, 0.0]),
        ([0.0, 8.0, -19.98], [0.0, 0.0, -1.0]),
    ] {
        let keys: Vec<String> = blue(center_mm, facing).into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["lights[0].shape.facing"], "{center_mm:?}");
    }
    // Into the sensor, along the wall, or at a wall that is elsewhere, a light may shine, and a two-sided one anywhere.
    for (center_mm, facing) in [
        ([-21.999, 0.0, -5.0], [1.0, 0.0, 0.0]),
        ([-21.999, 0.0, -5.0], [0.0, 0.0, 1.0]),
        ([-12.0, 0.0, -5.0], [-1.0, 0.0, 0.0]),
    ] {
        assert_eq!(blue(center_mm, facing), Vec::new());
    }
    let both = told(|optics| {
        let LightShapeSpec::Rectangle { facing, .. } = &mut optics.lights[0].shape else { unreachable!() };
        facing[0] = -1.0;
        optics.lights[0].two_sided = true;
    });
    assert_eq!(both, Vec::new());
}

#[test]
fn what_follows_from_a_wrong_value_is_not_told_beside_it() {
    let keys = |change: &dyn Fn(&mut SensorOptics)| -> Vec<String> {
        told(change).into_iter().map(|problem| problem.key).collect()
    };
    // The shipped coat has grain, which a metal film would hide.
    assert_eq!(keys(&|optics| optics.coating.roughness = -0.5), ["coating.roughness"]);
    assert_eq!(keys(&|optics| optics.coating.flakes = Some(1.5)), ["coating.flakes"]);
    assert_eq!(keys(&|optics| optics.coating.flakes = Some(1.0)), ["coating.flakes"]);
    let housing =
        |change: fn(&mut HousingSpec)| told(|optics| change(optics.housing.as_mut().expect("it has walls")));
    for (ends, next) in
        [([15.0, -15.0], "swap them: x_mm = [-15.0, 15.0]"), ([15.0, 15.0], "give two walls that are apart")]
    {
        let swapped = told(|optics| optics.housing.as_mut().unwrap().x_mm = ends);
        assert_eq!(swapped.len(), 1, "{swapped:?}");
        let Problem { key, allowed, .. } = &swapped[0];
        assert!(key == "housing.x_mm" && allowed.contains("the smaller one first"), "{swapped:?}");
        assert_eq!(swapped[0].next, next);
    }
    let below = housing(|housing| housing.height_mm = -20.0);
    assert!(below.len() == 1 && below[0].key == "housing.height_mm", "{below:?}");
    // Walls in order are told of all that stands behind them.
    let narrow = housing(|housing| housing.x_mm = [-21.0, 21.0]);
    assert_eq!(narrow.len(), 2, "{narrow:?}");
}

#[test]
fn a_light_of_triangles_shines_as_the_rectangle_that_they_make() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rig_configs/sensors/gelsight.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let rectangle = "{ kind = \"rectangle\", center_mm = [-21.999, 0.0, -5.0], facing = [1.0, 0.0, 0.0], size_mm = [24.0, 2.0] }";
    assert!(text.contains(rectangle));
    let mesh = "{ kind = \"mesh\", vertices_mm = [[-21.999, -12.0, -6.0], [-21.999, 12.0, -6.0], [-21.999, 12.0, -4.0], \
                [-21.999, -12.0, -4.0]], triangles = [[0, 1, 2], [0, 2, 3]] }";
    let mean = |text: &str| {
        let file: SensorFile = toml::from_str(text).unwrap();
        let mut problems = Problems::new();
        file.optics.check(&mut problems);
        assert_eq!(problems.into_vec(), Vec::new());
        let mut optics = file.optics;
        optics.lights.truncate(1);
        (optics.camera.width_px, optics.camera.height_px, optics.camera.mm_per_px) = (32, 24, 0.5625);
        optics.mesh.vertices = [0, 0];
        let rest = DisplacedSurface::flat(41, 41, [file.pad.size_x_mm, file.pad.size_y_mm]);
        let settings = reference::Settings { samples: 256, seed: 0 };
        imager::Imager::new(&optics, settings, None, &rest).unwrap().picture(&rest, 0).unwrap().light.mean().z
    };
    let (of_rectangle, of_mesh) = (mean(&text), mean(&text.replace(rectangle, mesh)));
    assert!((of_mesh / of_rectangle - 1.0).abs() < 0.01, "{of_mesh} {of_rectangle}");
    let beyond =
        toml::from_str::<SensorFile>(&text.replace(rectangle, &mesh.replace("[0, 2, 3]", "[0, 2, 4]")));
    let mut problems = Problems::new();
    beyond.unwrap().optics.check(&mut problems);
    assert_eq!(problems.into_vec()[0].key, "lights[0].shape.triangles");
}
