//! What the pad hides from the pieces of a pixel: looked at for all together that face alike.

use super::frame::Frame;
use super::horizon::Stand;
use super::piece::Piece;
use glam::Vec3;

/// Pieces whose normals have a larger cosine face alike.
const ALIKE: f32 = 0.8;
/// Facets that are higher are tall, mm.
const TALL_MM: f32 = 0.005;

/// A way that a part of a pixel faces, by its largest piece, and the places of its lowest and highest one.
struct Facet {
    normal: Vec3,
    point: Vec3,
    part: f32,
    ends: [Vec3; 2],
}

impl Facet {
    fn new(piece: &Piece) -> Self {
        Self { normal: piece.normal, point: piece.point, part: piece.part, ends: [piece.point; 2] }
    }

    fn add(&mut self, piece: &Piece) {
        if self.part < piece.part {
            (self.normal, self.point, self.part) = (piece.normal, piece.point, piece.part);
        }
        let [low, high] = &mut self.ends;
        if piece.point.z < low.z {
            *low = piece.point;
        }
        if piece.point.z > high.z {
            *high = piece.point;
        }
    }

    fn height_mm(&self) -> f32 {
        self.ends[1].z - self.ends[0].z
    }
}

/// Fills a node for each piece, of which horizons alone: those of the largest piece that faces alike, and on what is tall those
/// between its ends, for from the foot of a flank most of a light may be hidden, and nothing from its top.
pub fn horizons<const N: usize>(frame: &Frame<'_, N>, pieces: &[Piece], nodes: &mut Vec<f32>) {
    let mut facets: Vec<Facet> = Vec::new();
    let mut facet_of = Vec::with_capacity(pieces.len());
    for piece in pieces {
        let alike = |facet: &Facet| facet.normal.dot(piece.normal) > ALIKE;
        let k = facets.iter().position(alike).unwrap_or(facets.len());
        match facets.get_mut(k) {
            Some(facet) => facet.add(piece),
            None => facets.push(Facet::new(piece)),
        }
        facet_of.push(k);
    }
    let stride = frame.slots.stride();
    nodes.resize(pieces.len() * stride, 0.0);
    let mut ends = vec![0.0; 2 * stride];
    let (low, high) = ends.split_at_mut(stride);
    for (k, facet) in facets.iter().enumerate() {
        let is_tall = facet.height_mm() > TALL_MM;
        let on = |point: Vec3| Stand::on(point, facet.normal);
        frame.fill_horizons(on(if is_tall { facet.ends[0] } else { facet.point }), low);
        if is_tall {
            frame.fill_horizons(on(facet.ends[1]), high);
        }
        let own = nodes.chunks_exact_mut(stride).zip(pieces).zip(&facet_of).filter(|(_, of)| **of == k);
        for ((node, piece), _) in own {
            node.copy_from_slice(low);
            if is_tall {
                let up = (piece.point.z - facet.ends[0].z) / facet.height_mm();
                node.iter_mut().zip(&*high).for_each(|(own, high)| *own += (high - *own) * up);
                let flags = (0..frame.once.sources.len()).map(|l| frame.slots.light(l));
                flags.for_each(|flag| node[flag] = low[flag].max(high[flag]));
            }
        }
    }
}
