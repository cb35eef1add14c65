//! Patches of walls and lamps taken together: by place, side and reflectance.

use super::radiosity;
use super::world::World;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// Rays of a patch, by which it is known what else it lights, and how much of it is open.
pub const RAYS: u32 = 64;
/// Part of a patch that has to be open, not behind a lamp or under the pad, for it to stand for itself.
const LEAST_OPEN: f32 = 0.2;

/// Where a patch is, which way it looks, and what it reflects.
type Key = ([i32; 3], Side);
/// Which way a patch looks, and what it reflects.
type Side = (u32, [u32; 3]);

/// Patches in groups.
pub struct Grouping {
    /// By group.
    pub members: Vec<Vec<u32>>,
    /// By patch: its group, and the patches that its rays meet, one from each place of it that is open.
    known: HashMap<u32, (u16, Vec<u32>)>,
}

impl Grouping {
    /// Of the patches that `matter` ([`u32::MAX`] is none), in groups of this edge, mm.
    ///
    /// A patch that is all but covered goes with the nearest open one of its side: what little of it shows is met by a ray or by none,
    /// and a group of such alone would be as bright as all the light that it is told of over next to no area. (Of a wall that a lamp
    /// hides but for a few micrometres, one ray from a node told of a third more light than there was.)
    pub fn new(
        world: &World,
        matter: impl Iterator<Item = u32>,
        edge: f32,
        buried: &(impl Fn(glam::Vec3) -> bool + Sync),
    ) -> Self {
        let key_of = |element: u32| -> Key {
            let (point, normal) = world.middle(element as usize);
            let size = normal.abs();
            let axis = if size.z >= size.max_element() { 2 } else { u32::from(size.y > size.x) };
            let side = 2 * axis + u32::from(normal[axis as usize] < 0.0);
            let albedo = world.element(element as usize).0.to_array().map(f32::to_bits);
            ((point / edge).floor().as_ivec3().to_array(), (side, albedo))
        };
        let mut found = HashSet::new();
        let mut patches: Vec<u32> = matter.filter(|e| *e != u32::MAX && found.insert(*e)).collect();
        let mut keys: Vec<Key> = patches.iter().map(|e| key_of(*e)).collect();
        // Small patches of a group that no ray happened to meet are of its area, too.
        let groups_met: HashSet<Key> = keys.iter().copied().collect();
        for element in (0..2 * world.patches as u32).filter(|e| !found.contains(e)) {
            let key = key_of(element);
            if groups_met.contains(&key) {
                patches.push(element);
                keys.push(key);
            }
        }
        let meets = |element: &u32| -> Vec<u32> {
            let met = radiosity::met_by(world, *element as usize, RAYS, buried);
            met.into_iter().map(|(element, _)| element).collect()
        };
        let met: Vec<Vec<u32>> = patches.par_iter().map(meets).collect();
        let is_open = |k: &usize| met[*k].len() as f32 >= LEAST_OPEN * RAYS as f32;
        let mut open: HashMap<Side, Vec<usize>> = HashMap::new();
        for k in (0..patches.len()).filter(is_open) {
            open.entry(keys[k].1).or_default().push(k);
        }
        let place = |k: usize| world.middle(patches[k] as usize).0;
        let goes_with = |k: usize| {
            let from = |other: &usize| place(*other).distance_squared(place(k));
            let others = open.get(&keys[k].1).filter(|_| !is_open(&k));
            let nearest = others.and_then(|others| others.iter().min_by(|a, b| from(a).total_cmp(&from(b))));
            keys[*nearest.unwrap_or(&k)]
        };
        let key_of_group: Vec<Key> = (0..patches.len()).into_par_iter().map(goes_with).collect();
        let mut groups: HashMap<Key, u16> = HashMap::new();
        let (mut members, mut known) = (Vec::new(), HashMap::new());
        for ((element, met), key) in patches.into_iter().zip(met).zip(key_of_group) {
            let group = *groups.entry(key).or_insert_with(|| {
                members.push(Vec::new());
                (members.len() - 1) as u16
            });
            members[usize::from(group)].push(element);
            known.insert(element, (group, met));
        }
        Self { members, known }
    }

    /// The group of a patch, if it is in any.
    pub fn of(&self, element: u32) -> Option<u16> {
        self.known.get(&element).map(|(group, _)| *group)
    }

    /// What the rays of a patch of a group meet, [`u32::MAX`] where nothing.
    pub fn met_by(&self, element: u32) -> &[u32] {
        self.known.get(&element).map_or(&[], |(_, met)| met)
    }

    /// How much of a patch is open.
    pub fn open_part(&self, element: u32) -> f32 {
        self.met_by(element).len() as f32 / RAYS as f32
    }

    /// All patches in order, each with its group.
    pub fn patches(&self) -> Vec<(u32, u16)> {
        let mut patches: Vec<(u32, u16)> =
            self.known.iter().map(|(element, (group, _))| (*element, *group)).collect();
        patches.sort_unstable();
        patches
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::bench_scene::Variant;
    use crate::optics::stress::lamps::further_out;
    use crate::optics::trial::{Press, Trial};

    /// Low strips before walls hide some patches of these but for a few micrometres.
    #[test]
    fn no_group_is_all_but_hidden() {
        let trial =
            Trial::new(Variant::Ac, Press::Sphere, [64, 48], [201, 151]).unwrap().changed(further_out);
        let world = World::new(&trial.untouched, true).unwrap();
        let all = 0..2 * world.patches as u32;
        let grouping = Grouping::new(&world, all.clone(), 1.25, &|_| false);
        let areas = |members: &[u32]| {
            members.iter().fold([0.0; 2], |[open, whole], element| {
                let area = world.area(*element as usize);
                [open + grouping.open_part(*element) * area, whole + area]
            })
        };
        let rooms = grouping.members.iter().map(|members| areas(members));
        let least = rooms.map(|[open, whole]| open / whole).fold(f32::INFINITY, f32::min);
        assert!(least > 0.9 * LEAST_OPEN, "{least}");
        // Such patches there are.
        let hidden = all.filter(|element| grouping.open_part(*element) < 0.1).count();
        assert!(hidden > 10, "{hidden}");
    }
}
