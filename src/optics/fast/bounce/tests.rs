use super::*;

static NO_TILTS: Tilts = Tilts::NONE;

/// No walls over a level face without light.
const DARK: Untouched<'static> =
    Untouched { sky: &|_, _| [0.0; skyline::NUMBERS], ground: &|_, _| Vec3::ZERO, normal: &|_| Vec3::Z };

/// White cells seen from high above.
pub(super) fn white<'a>(
    size: [usize; 2],
    edge_mm: f32,
    cells: &'a [Cell],
    lights: &'a [Vec<Vec3>],
    heights: &'a Heights,
    extent: [Vec2; 2],
) -> Cells<'a> {
    let (eye, albedo) = (Vec3::new(0.0, 0.0, 20.0), Vec3::ONE);
    // (None is corrected as a flank: the light that the tests give is what others see.)
    let flanks = &[false; 1 << 13][..cells.len()];
    Cells {
        size,
        rows: size[1],
        edge_mm,
        sending: super::SENDING,
        cells,
        flanks,
        kept: &[],
        tilts: &NO_TILTS,
        lights,
        most_count: 1.0,
        albedo,
        eye,
        extent,
        heights,
        echo: None,
        lost: &[],
        unseen: &[],
        unseen_lights: &[],
        packing: Packing::Apart,
        radiances: &[],
        again: false,
        closely: true,
    }
}

/// A pad of these heights.
pub(super) fn heights(extent: [Vec2; 2], z: impl Fn(Vec2) -> f32) -> Heights {
    let n = 401;
    let share = |k: usize| Vec2::new((k % n) as f32, (k / n) as f32) / (n - 1) as f32;
    let at = |k: usize| extent[0] + (extent[1] - extent[0]) * share(k);
    let positions: Vec<Vec3> = (0..n * n).map(|k| at(k).extend(z(at(k)))).collect();
    Heights::new(&positions, [n, n], 0.05)
}

#[test]
fn a_narrow_flank_stands_for_a_cell_of_which_it_is_the_larger_part() {
    let flat =
        Cell { position: Vec3::new(3.0, 0.0, 0.0), normal: Vec3::Z * 3.0, area: 3.0, level: 3.0, count: 3.0 };
    let flank = Cell {
        position: Vec3::new(1.0, 0.0, 0.5),
        normal: Vec3::X * 18.0,
        area: 18.0,
        level: 0.0,
        count: 1.0,
    };
    let (cell, steep) = Cell::of(&flat, &flank);
    assert!(steep && cell.area == 21.0 && cell.level == 3.0 && cell.normal.normalize() == Vec3::X);
    // Four pixels are counted, and lie where the flank does.
    assert_eq!(cell.position / cell.count, Vec3::new(1.0, 0.0, 0.5));
    let (cell, steep) = Cell::of(&flat, &EMPTY);
    assert!(!steep && cell == flat);
}

/// A wall of height 1 along x = `edge_x`, up to which the eye sees a floor and beyond which a plateau.
fn step(edge_x: f32) -> ([usize; 2], f32, Vec<Cell>) {
    let (nx, ny, edge) = (81, 81, 0.25);
    let at = |k: usize| (Vec2::new((k % nx) as f32, (ny - 1 - k / nx) as f32) - 40.0) * edge;
    // What is seen at a place of the level is nearer to the middle where it is high.
    let cell = |k: usize| {
        let (floor, plateau) = (at(k), at(k) * (1.0 - 1.0 / 20.0));
        let flat = |p: Vec3| Cell { position: p, normal: Vec3::Z, area: 1.0, level: 1.0, count: 1.0 };
        if (floor.x - 0.5 * edge..floor.x + 0.5 * edge).contains(&edge_x) {
            let position = Vec3::new(edge_x, floor.y, 0.5);
            return Cell { position, normal: -Vec3::X, area: 1.0 / edge, level: 1.0, count: 1.0 };
        }
        if floor.x < edge_x { flat(floor.extend(0.0)) } else { flat(plateau.extend(1.0)) }
    };
    ([nx, ny], edge, (0..nx * ny).map(cell).collect())
}

/// The floor sees the wall under a known form factor, in the middle of the picture and towards its border, where what
/// is high is seen elsewhere than it stands.
#[test]
fn a_step_lights_its_foot_by_its_form_factor() {
    for edge_x in [0.06, 5.06] {
        let ([nx, ny], edge, cells) = step(edge_x);
        let extent = [Vec2::splat(-10.125), Vec2::splat(10.125)];
        let pad = heights(extent, |p| f32::from(u8::from(p.x > edge_x)));
        let foot = cells.iter().position(|c| c.position.z > 0.0).unwrap();
        // The wall shines as does what is behind it; the sky is dark, as is the ground in the eyes of the wall.
        let light: Vec<Vec3> =
            cells.iter().map(|c| Vec3::splat(if c.position.z > 0.0 { c.area } else { 1e-3 })).collect();
        let lights = [light.clone(), light.iter().map(|l| *l * 2.0).collect()];
        let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
        let gains = all.changes(DARK).gains;
        // (The change is told as part of the light that is there, which is bounded: brighter ground is changed less.)
        let bright = [cells.iter().map(|c| Vec3::splat(c.area)).collect()];
        let of_bright = Cells { lights: &bright, ..all }.changes(DARK).gains;
        // An endless wall of height h at distance d fills (1 - cos(atan(h/d)))/2 of the floor's view.
        for i in [foot - 20, foot - 12, foot - 5, foot - 3, foot - 2, foot - 1] {
            let k = 40 * nx + i;
            let d = edge_x - cells[k].position.x;
            let truth: f32 = 0.5 * (1.0 - d / d.hypot(1.0));
            let gain = of_bright[0][k].x;
            assert!(((gain - 1.0) / truth - 1.0).abs() < 0.1, "{edge_x} {d}: {gain} {truth}");
        }
        let k = 40 * nx + foot;
        assert!(gains[0][k - 1].x > 2.9, "what was dark is bounded");
        assert_eq!(gains[0][k + 15], Vec3::ONE, "from the plateau nothing higher is seen");
        // Twice the light is twice the change.
        for (a, b) in gains[0].iter().zip(&gains[1]) {
            assert!((*a - *b).abs().max_element() < 1e-5, "{a} {b}");
        }
    }
}

/// What is far from a wall passes over cells, and sees the wall all the same, not the plateau behind it.
#[test]
fn from_afar_a_wall_is_seen_and_not_what_is_behind_it() {
    let edge_x = 0.06;
    let ([nx, ny], edge, cells) = step(edge_x);
    let extent = [Vec2::splat(-10.125), Vec2::splat(10.125)];
    let pad = heights(extent, |p| f32::from(u8::from(p.x > edge_x)));
    let foot = cells.iter().position(|c| c.position.z > 0.0).unwrap();
    let light = |c: &Cell| Vec3::splat(if c.position.z == 1.0 { 1e-3 } else { c.area });
    let lights = [cells.iter().map(light).collect()];
    let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
    for closely in [true, false] {
        let gains = Cells { closely, ..all }.changes(DARK).gains;
        // (From farther away the ends of the wall are in view.)
        for i in (2..=20).map(|away| foot - away) {
            let d = edge_x - cells[40 * nx + i].position.x;
            let truth = 0.5 * (1.0 - d / d.hypot(1.0));
            let found = gains[0][40 * nx + i].x - 1.0;
            assert!((found / truth - 1.0).abs() < 0.1, "{closely} {d}: {found} {truth}");
        }
    }
}

/// What is at the foot of a wall sees its lowest part most, and nothing of itself in it.
#[test]
fn a_foot_sees_the_low_part_of_a_flank() {
    let edge_x = -0.12;
    let ([nx, ny], edge, cells) = step(edge_x);
    let extent = [Vec2::splat(-10.125), Vec2::splat(10.125)];
    let pad = heights(extent, |p| f32::from(u8::from(p.x > edge_x)));
    let upright = |c: &Cell| c.normal.x < 0.0;
    let foot = cells.iter().position(upright).unwrap();
    let flanks: Vec<bool> = cells.iter().map(upright).collect();
    // The floor is brighter than the wall, whose light changes with height.
    let light = |c: &Cell| Vec3::splat(if c.position.z > 0.0 { c.area } else { 2.0 * c.area });
    let lights = [cells.iter().map(light).collect()];
    // (What is reflected once is small beside the light, so what is reflected again is nothing.)
    let albedo = 0.01;
    for by_mm in [-0.8, 0.0, 0.8] {
        let of_flanks =
            |value: f32| flanks.iter().map(|f| if *f { value } else { 0.0 }).collect::<Vec<f32>>();
        let tilts = Tilts {
            lights: vec![of_flanks(by_mm).into_iter().map(Vec3::splat).collect()],
            lower_mm: of_flanks(0.35),
        };
        let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
        let all = Cells { flanks: &flanks, tilts: &tilts, albedo: Vec3::splat(albedo), ..all };
        let gains = all.changes(DARK).gains;
        for i in [foot - 8, foot - 5, foot - 3, foot - 2, foot - 1] {
            let k = 40 * nx + i;
            let d = edge_x - cells[k].position.x;
            // Strips of it fill d z/(2 (d^2 + z^2)^(3/2)) dz of the view.
            let (whole, first) = (1.0 - d / d.hypot(1.0), d * ((1.0 / d).asinh() - 1.0 / d.hypot(1.0)));
            let truth = 0.5 * albedo * ((1.0 - 0.5 * by_mm) * whole + by_mm * first) / 2.0;
            let found = gains[0][k].x - 1.0;
            assert!((found / truth - 1.0).abs() < 0.08, "{by_mm} {d}: {found} {truth}");
        }
    }
}

/// A face that is even, however it leans, sees nothing of itself.
#[test]
fn a_leaning_plane_sees_nothing_of_itself() {
    let (nx, ny, edge) = (41, 33, 0.25);
    let up = Vec3::new(-0.9, 0.4, 1.0);
    let cells: Vec<Cell> = (0..nx * ny)
        .map(|k| {
            let (x, y) = ((k % nx) as f32 * edge, (k / nx) as f32 * -edge);
            let position = Vec3::new(x, y, 0.9 * x - 0.4 * y);
            Cell { position, normal: up, area: up.length(), level: 1.0, count: 1.0 }
        })
        .collect();
    let lights = [vec![Vec3::ONE; nx * ny]];
    let extent = [Vec2::new(0.0, -8.0), Vec2::new(10.0, 0.0)];
    let pad = heights(extent, |p| 0.9 * p.x - 0.4 * p.y);
    let all = white([nx, ny], edge, &cells, &lights, &pad, extent);
    for gain in &all.changes(DARK).gains[0] {
        assert!((*gain - Vec3::ONE).abs().max_element() < 1e-3, "{gain}");
    }
}

/// Where one plane rises from another, along a fold that runs aslant to the cells, the steeper is seen from the other under their
/// angle, and nowhere else: a cell beside the way does not stand in it.
#[test]
fn a_fold_lights_itself_by_its_angle() {
    let (n, edge) = (41, 0.25);
    let across = Vec2::from_angle(0.65);
    let height = |p: Vec2| across.dot(p) * if across.dot(p) > 0.0 { 2.4 } else { 1.2 };
    let at = |k: usize| Vec2::new((k % n) as f32 - 20.0, 20.0 - (k / n) as f32) * edge;
    let cells: Vec<Cell> = (0..n * n)
        .map(|k| {
            let p = at(k);
            let slope = across * if across.dot(p) > 0.0 { 2.4 } else { 1.2 };
            let up = (-slope).extend(1.0);
            Cell { position: p.extend(height(p)), normal: up, area: up.length(), level: 1.0, count: 1.0 }
        })
        .collect();
    let lights = [cells.iter().map(|c| Vec3::splat(c.area)).collect()];
    let extent = [Vec2::splat(-5.125), Vec2::splat(5.125)];
    let pad = heights(extent, height);
    // (From so far that heights do not move what is seen.)
    let all = Cells { eye: Vec3::Z * 1e5, ..white([n, n], edge, &cells, &lights, &pad, extent) };
    let gains = all.changes(DARK).gains;
    // Far from the ends an endless plane that rises by an angle over another fills (1 - cos)/2 of its view.
    let truth = 0.5 * (1.0 - (2.4f32.atan() - 1.2f32.atan()).cos());
    let near = |k: &usize| (-0.5..-0.1).contains(&across.dot(at(*k))) && at(*k).length() < 2.0;
    let found: Vec<f32> = (0..n * n).filter(near).map(|k| gains[0][k].x - 1.0).collect();
    let mean = found.iter().sum::<f32>() / found.len() as f32;
    let most = found.iter().fold(0.0f32, |most, more| most.max(*more));
    assert!((mean / truth - 1.0).abs() < 0.25 && most < 2.0 * truth, "{mean}, {most}: {truth}");
}
