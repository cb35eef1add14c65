//! What was worked out once, as bytes, and the key that it follows from.

use super::cover::{Covers, SAMPLES};
use super::echo::Echo;
use super::glow::{Glow, Spot};
use super::grid::{Grid, Places};
use super::pad_image::PadImage;
use super::wall_shadow::Low;
use super::{Precomputed, Tables};
use crate::optics::{Albedo, Material, Mesh, Role, Scene};
use glam::{Vec2, Vec3};

/// Changes whenever tables of the same scene would be worked out differently, or are written differently.
const FORMAT: u32 = 30;

/// The hash of everything that the tables follow from.
pub fn key(scene: &Scene) -> [u8; 32] {
    let mut hash = blake3::Hasher::new();
    let mut put = |bytes: &[u8]| {
        hash.update(&(bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    put(&FORMAT.to_le_bytes());
    put(format!("{:?} {}", scene.camera, scene.max_events).as_bytes());
    for surface in &scene.surfaces {
        put(format!("{:?}", surface.role).as_bytes());
        // A pad's texture counts by its mean alone.
        let material = match (&surface.material, surface.role) {
            (Material::Lambert { albedo: Albedo::Texture(t) }, Role::Pad) => format!("mean {:?}", t.mean()),
            (material, _) => format!("{material:?}"),
        };
        put(material.as_bytes());
        put(&mesh_bytes(&surface.mesh));
    }
    for light in &scene.lights {
        // Tables are for radiance 1: colours may change.
        put(format!("{:?} {} {} {:?}", light.shape, light.two_sided, light.cosine_power, light.albedo)
            .as_bytes());
    }
    *hash.finalize().as_bytes()
}

fn mesh_bytes(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(12 * mesh.positions.len());
    mesh.positions.iter().flat_map(|p| p.to_array()).for_each(|v| bytes.extend(v.to_le_bytes()));
    match mesh.lattice {
        Some(size) => size.iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes())),
        None => mesh.triangles.iter().flatten().for_each(|i| bytes.extend(i.to_le_bytes())),
    }
    bytes
}

/// The tables as bytes.
pub fn encode(tables: &Tables) -> Vec<u8> {
    let mut out = Vec::new();
    let words = |out: &mut Vec<u8>, values: &mut dyn Iterator<Item = f32>| {
        let at = out.len();
        out.extend(0u64.to_le_bytes());
        let mut n = 0u64;
        for value in values {
            out.extend(value.to_le_bytes());
            n += 1;
        }
        out[at..at + 8].copy_from_slice(&n.to_le_bytes());
    };
    fn grid<const N: usize>(
        out: &mut Vec<u8>,
        words: &impl Fn(&mut Vec<u8>, &mut dyn Iterator<Item = f32>),
        grid: &Grid<N>,
    ) {
        let (places, values) = grid.parts();
        let (numbers, nodes, rest) = places.parts();
        words(out, &mut numbers.into_iter());
        words(out, &mut nodes.into_iter().map(|n| n as f32));
        words(out, &mut rest.iter().copied());
        words(out, &mut values.iter().flatten().copied());
    }
    words(&mut out, &mut [tables.direct.len() as f32, tables.veils.len() as f32].into_iter());
    for table in &tables.direct {
        words(&mut out, &mut [f32::from(u8::from(table.is_some()))].into_iter());
        if let Some(table) = table {
            grid(&mut out, &words, table);
        }
    }
    tables.probes.iter().for_each(|probes| grid(&mut out, &words, probes));
    tables.skylines.iter().for_each(|skyline| grid(&mut out, &words, skyline));
    words(&mut out, &mut tables.fixed.iter().copied());
    // (Single precision counts to sixteen million pixels.)
    words(&mut out, &mut tables.covers.pixels.iter().map(|k| *k as f32));
    words(&mut out, &mut tables.covers.values.iter().flatten().copied());
    for vectors in tables.fixed_lights.iter().chain(&tables.covers.lights).chain(&tables.veils) {
        words(&mut out, &mut vectors.iter().flat_map(|v| v.to_array()));
    }
    words(&mut out, &mut tables.glow.pixels.iter().flatten().map(|k| *k as f32));
    let numbers_of = |spot: &Spot| {
        let nine = [spot.point, spot.normal, spot.albedo].map(|v| v.to_array());
        let shines = [f32::from(u8::from(spot.shines))];
        nine.as_flattened().iter().chain(&shines).chain(&spot.direct).copied().collect::<Vec<f32>>()
    };
    words(&mut out, &mut tables.glow.spots.iter().flat_map(numbers_of));
    if let Some(echo) = &tables.echo {
        let (numbers, nodes, rest) = echo.places.parts();
        words(
            &mut out,
            &mut [echo.size[0], echo.size[1], echo.groups, echo.colours].into_iter().map(|n| n as f32),
        );
        let numbers_of = |low: &Low| {
            let place = [f32::from(low.group), low.point.x, low.point.y, low.point.z];
            place.into_iter().chain(low.power.clone())
        };
        words(&mut out, &mut echo.low.iter().flat_map(numbers_of));
        words(&mut out, &mut echo.ends.iter().map(|end| f32::from(*end)));
        words(&mut out, &mut numbers.into_iter());
        words(&mut out, &mut nodes.into_iter().map(|n| n as f32));
        words(&mut out, &mut rest.iter().copied());
        words(&mut out, &mut echo.response.iter().copied());
        words(&mut out, &mut echo.image.counts.iter().map(|n| *n as f32));
        words(&mut out, &mut echo.image.of.iter().map(|n| *n as f32));
        words(&mut out, &mut echo.image.parts.iter().flatten().copied());
    }
    out
}

/// The tables from bytes; None when they are no tables.
pub fn decode(bytes: &[u8]) -> Option<Tables> {
    let mut reader = Reader { bytes };
    let [lights, veils] = reader.words()?[..] else { return None };
    let lights = lights as usize;
    let direct = (0..lights)
        .map(|_| {
            let has = *reader.words()?.first()? > 0.0;
            Some(if has { Some(reader.grid()?) } else { None })
        })
        .collect::<Option<Vec<_>>>()?;
    let probes = (0..lights).map(|_| reader.grid()).collect::<Option<Vec<_>>>()?;
    let skylines = (0..lights).map(|_| reader.grid()).collect::<Option<Vec<_>>>()?;
    let fixed = reader.words()?;
    let pixels = reader.words()?.into_iter().map(|k| k as u32).collect();
    let values = reader.words()?.as_chunks::<SAMPLES>().0.to_vec();
    let fixed_lights = (0..lights).map(|_| reader.vectors()).collect::<Option<Vec<_>>>()?;
    let cover_lights = (0..lights).map(|_| reader.vectors()).collect::<Option<Vec<_>>>()?;
    let covers = Covers { pixels, values, lights: cover_lights };
    let veils = (0..veils as usize).map(|_| reader.vectors()).collect::<Option<Vec<_>>>()?;
    let glow = reader.glow(lights)?;
    let echo = if reader.bytes.is_empty() { None } else { Some(reader.echo(lights)?) };
    reader.bytes.is_empty().then_some(Tables {
        direct,
        probes,
        skylines,
        fixed,
        fixed_lights,
        covers,
        glow,
        veils,
        echo,
    })
}

struct Reader<'a> {
    bytes: &'a [u8],
}

impl Reader<'_> {
    fn words(&mut self) -> Option<Vec<f32>> {
        let (n, rest) = self.bytes.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*n)).ok()?.checked_mul(4)?;
        let (words, rest) = rest.split_at_checked(length)?;
        self.bytes = rest;
        Some(words.chunks_exact(4).map(|w| f32::from_le_bytes([w[0], w[1], w[2], w[3]])).collect())
    }

    fn vectors(&mut self) -> Option<Vec<Vec3>> {
        Some(self.words()?.chunks_exact(3).map(Vec3::from_slice).collect())
    }

    fn glow(&mut self, lights: usize) -> Option<Glow> {
        let pixels = self.words()?.as_chunks::<2>().0.iter().map(|pair| pair.map(|k| k as u32)).collect();
        let spots = self.words()?;
        let spots = spots.chunks_exact(10 + lights).map(|n| Spot {
            point: Vec3::from_slice(n),
            normal: Vec3::from_slice(&n[3..]),
            albedo: Vec3::from_slice(&n[6..]),
            shines: n[9] > 0.0,
            direct: n[10..].to_vec(),
        });
        Some(Glow { pixels, spots: spots.collect() })
    }

    fn echo(&mut self, lights: usize) -> Option<Echo> {
        let numbers: [f32; 4] = self.words()?.try_into().ok()?;
        let [nx, ny, groups, colours] = numbers.map(|n| n as usize);
        let low = self.words()?;
        let low = low.chunks_exact(4 + lights).map(|n| Low {
            group: n[0] as u16,
            point: Vec3::from_slice(&n[1..]),
            power: n[4..].to_vec(),
        });
        let low = low.collect();
        let ends = self.words()?.iter().map(|end| *end as u16).collect();
        let (places, response) = (self.places()?, self.words()?);
        let [counts, of] = [self.words()?, self.words()?].map(|n| n.into_iter().map(|n| n as u32).collect());
        let image = PadImage { counts, of, parts: self.words()?.as_chunks().0.to_vec() };
        let echo = Echo { size: [nx, ny], ends, places, response, groups, colours, low, image };
        echo.fits().then_some(echo)
    }

    fn places(&mut self) -> Option<Places> {
        let numbers: [f32; 6] = self.words()?.try_into().ok()?;
        let nodes: [f32; 3] = self.words()?.try_into().ok()?;
        Places::from_parts(numbers, nodes.map(|n| n as usize), self.words()?)
    }

    fn grid<const N: usize>(&mut self) -> Option<Grid<N>> {
        let places = self.places()?;
        let values: Vec<[f32; N]> = self.words()?.as_chunks::<N>().0.to_vec();
        (values.len() == places.count()).then(|| Grid::from_values(places, values))
    }
}

impl Places {
    /// Everything, as numbers.
    fn parts(&self) -> ([f32; 6], [usize; 3], &[f32]) {
        let numbers = [self.low.x, self.low.y, self.per_mm.x, self.per_mm.y, self.lift_low, self.lift_per_mm];
        (numbers, self.nodes, &self.rest)
    }

    fn from_parts(n: [f32; 6], nodes: [usize; 3], rest: Vec<f32>) -> Option<Self> {
        let fits = nodes.iter().all(|n| (2..=401).contains(n)) && rest.len() == nodes[0] * nodes[1];
        fits.then(|| Self {
            low: Vec2::new(n[0], n[1]),
            per_mm: Vec2::new(n[2], n[3]),
            nodes,
            lift_low: n[4],
            lift_per_mm: n[5],
            rest,
        })
    }
}

impl Precomputed {
    /// The hash of everything that preparing a sensor follows from: all but the colours of its lights.
    pub fn key(untouched: &Scene) -> [u8; 32] {
        key(untouched)
    }

    /// What took long to work out, as bytes.
    pub fn encode(&self) -> Vec<u8> {
        encode(&self.tables)
    }
}
