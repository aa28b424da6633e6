//! Joint groups: which joints share a quad, and which joint the quad follows.
//!
//! Hands keep their fingers, feet their toes and heads their faces, by name. All else is measured: joints that move little
//! against each other in the character's clips, or carry little surface, are merged until few enough groups are left, the
//! cheapest merge first. Where the names or the clips say nothing, sizes still do.
//!
//! Source: Izquierdo 2014, §4.2.1 (merging by hand); the measure is ours.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{Affine3A, Mat4, Vec3, Vec4};

use crate::baked::{Baked, PaletteEntry};
use crate::character::{Joint, Node};
use crate::error::ImportError;
use crate::quantize::{decode_position, decode_weights};
use crate::words::words;

/// Most groups that rules make of a character with hands; a sidecar file may ask for [`MAX_GROUPS`].
pub const RULE_GROUPS: usize = 15;
/// Most groups that rules make of others: backs, necks and tails bend more.
pub const RULE_GROUPS_WITHOUT_HANDS: usize = 18;
/// Most groups.
pub const MAX_GROUPS: usize = 64;

/// Poses of the clips that joints are compared in.
const POSES: usize = 48;
/// A rotation that any joint may make, radians: what a merge costs at least, in place of clips not seen yet.
const FREE_ROTATION: f32 = 0.15;
/// The same for people's arms and legs, which bend in some clip sooner or later.
const FREE_LIMB_ROTATION: f32 = 0.5;
/// Joints with less than this share of the surface are no group of their own.
const LEAST_SHARE: f64 = 1e-3;

/// The groups of a character's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Groups {
    /// Group of every palette joint.
    pub of_joint: Vec<u8>,
    /// The groups.
    pub groups: Vec<Group>,
}

/// Joints that share a quad.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// For people: the driving joint's name, or what a sidecar file says.
    pub name: String,
    /// The joint that the quad follows.
    pub driver: u32,
    /// It is the head, which deserves more views and texels.
    pub is_head: bool,
}

impl Groups {
    /// Groups by rule. Every group has surface; there is at least one.
    pub fn by_rule(baked: &Baked) -> Self {
        let joints = Joints::measure(baked);
        let mut of = joints.merged_by_name();
        joints.merge_cheapest(&mut of);
        joints.finish(&of, None)
    }

    /// Groups as a sidecar file states them: a TOML table from group names to lists of joint names. Joints that no list
    /// names go with their nearest listed ancestor.
    ///
    /// Errors: [`ImportError::Io`]; [`ImportError::Malformed`] where the TOML is broken, a joint does not exist, is listed
    /// twice or belongs to no group, or there are too many groups.
    pub fn from_sidecar(path: &Path, baked: &Baked) -> Result<Self, ImportError> {
        let text = std::fs::read_to_string(path).map_err(|source| ImportError::Io {
            path: path.to_path_buf(),
            source,
        })?;
        Self::from_toml(path, &text, baked)
    }

    /// As [`Self::from_sidecar`], from the file's text; `path` is for error messages.
    ///
    /// Errors: [`ImportError::Malformed`].
    pub fn from_toml(path: &Path, text: &str, baked: &Baked) -> Result<Self, ImportError> {
        let bad = |place: &str, reason: String| ImportError::malformed(path, place, reason);
        let lists: BTreeMap<String, Vec<String>> =
            toml::from_str(text).map_err(|e| bad("groups", e.to_string().trim_end().into()))?;
        if lists.is_empty() || lists.len() > MAX_GROUPS {
            let reason = format!(
                "there are {} groups, and 1 to {MAX_GROUPS} can be",
                lists.len()
            );
            return Err(bad("groups", reason));
        }
        let joints = Joints::measure(baked);
        let mut listed: Vec<Option<usize>> = vec![None; joints.names.len()];
        for (group, (name, members)) in lists.iter().enumerate() {
            let place = format!("group '{name}'");
            for member in members {
                let Some(joint) = joints.names.iter().position(|n| n == member) else {
                    let names = joints.names.join(", ");
                    let reason =
                        format!("there is no joint '{member}'; the character has: {names}");
                    return Err(bad(&place, reason));
                };
                if listed[joint].replace(group).is_some() {
                    return Err(bad(&place, format!("joint '{member}' is listed twice")));
                }
            }
            if members.is_empty() {
                return Err(bad(&place, "it lists no joint".into()));
            }
        }
        let mut of = vec![0; listed.len()];
        for (joint, of) in of.iter_mut().enumerate() {
            let found = joints.ancestors(joint).find_map(|j| listed[j]);
            *of = match found {
                Some(group) => group,
                None if joints.shares[joint] == 0.0 => {
                    listed.iter().flatten().copied().next().unwrap_or(0)
                }
                None => {
                    let name = &joints.names[joint];
                    return Err(bad(
                        "groups",
                        format!(
                            "joint '{name}' moves vertices, and neither it nor a joint above it is listed"
                        ),
                    ));
                }
            };
        }
        let names: Vec<String> = lists.into_keys().collect();
        for (group, name) in names.iter().enumerate() {
            let members: Vec<usize> = (0..of.len()).filter(|&j| of[j] == group).collect();
            if joints.surface(&members) == 0.0 {
                return Err(bad(
                    &format!("group '{name}'"),
                    "its joints move no vertices".into(),
                ));
            }
        }
        Ok(joints.finish(&of, Some(&names)))
    }
}

/// What the rules know of the joints.
struct Joints {
    names: Vec<String>,
    /// The nearest joint above.
    parents: Vec<Option<usize>>,
    /// Share of the surface, by weight.
    shares: Vec<f64>,
    /// Mean squared distance, weighted by surface, by which a joint's surface is off where it follows another joint,
    /// `[joint][follows]`.
    misplaced: Vec<f32>,
}

impl Joints {
    fn measure(baked: &Baked) -> Self {
        let count = baked.joints.len();
        let name_of = |joint: usize| {
            let node = baked.nodes.get(baked.joints[joint].node as usize);
            node.map_or_else(String::new, |n| n.name.clone())
        };
        let mut shares = vec![0.0f64; count];
        // Sums of share times `v v^T` with `v = (position, 1)`, bind space.
        let mut moments = vec![Mat4::ZERO; count];
        for s in &baked.submeshes {
            let vertices = &baked.vertices[s.first_vertex as usize..][..s.vertex_count as usize];
            let Some(band) = baked.bands.get(s.first_band as usize) else {
                continue;
            };
            let window = &baked.indices[band.first_index as usize..][..band.index_count as usize];
            for corners in window.chunks_exact(3) {
                let corners = [0, 1, 2].map(|k| &vertices[corners[k] as usize]);
                let [a, b, c] =
                    corners.map(|v| decode_position(v, baked.position_min, baked.position_extent));
                let area = (b - a).cross(c - a).length() / 6.0;
                for (v, place) in corners.into_iter().zip([a, b, c]) {
                    let v4 = place.extend(1.0);
                    for (joint, weight) in v.joints.into_iter().zip(decode_weights(v.weights)) {
                        shares[joint as usize] += f64::from(area * weight);
                        moments[joint as usize] += outer(v4) * (area * weight);
                    }
                }
            }
        }
        let total: f64 = shares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        shares.iter_mut().for_each(|s| *s /= total);
        moments.iter_mut().for_each(|m| *m *= (1.0 / total) as f32);
        let frames: usize = baked.clips.iter().map(|c| c.frame_count as usize).sum();
        let poses = (0..POSES.min(frames)).map(|p| {
            let frame = p * frames / POSES.min(frames);
            let entries = &baked.palette[frame * count..][..count];
            entries.iter().map(PaletteEntry::to_affine).collect()
        });
        let poses: Vec<Vec<Affine3A>> = poses.collect();
        let places = super::pose::joint_places(&baked.joints);
        let mut misplaced = vec![0.0; count * count];
        for joint in (0..count).filter(|&j| shares[j] > 0.0) {
            let rotation = match is_limb(&name_of(joint)) {
                true => FREE_LIMB_ROTATION,
                false => FREE_ROTATION,
            };
            let free = free_motion(&moments[joint], places[joint], rotation);
            for follows in (0..count).filter(|&d| d != joint) {
                misplaced[joint * count + follows] =
                    free + clip_motion(&moments[joint], &poses, joint, follows);
            }
        }
        Self {
            names: (0..count).map(name_of).collect(),
            parents: super::pose::joint_parents(&baked.nodes, &baked.joints),
            shares,
            misplaced,
        }
    }

    /// A joint and those above it.
    fn ancestors(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(joint), |&j| self.parents[j])
    }

    /// The member that moves the group's surface best, the first of them where nothing tells, and by how much it is off.
    fn driver(&self, members: &[usize]) -> (usize, f32) {
        let count = self.names.len();
        let mut best = (members[0], f32::INFINITY);
        for &d in members.iter().filter(|&&d| self.shares[d] > 0.0) {
            let cost: f32 = members.iter().map(|&j| self.misplaced[j * count + d]).sum();
            if cost < best.1 {
                best = (d, cost);
            }
        }
        best
    }

    /// Group numbers (a member's joint number) after hands, feet and heads took what hangs in them, and joints without
    /// surface of their own went with their parents.
    fn merged_by_name(&self) -> Vec<usize> {
        let kind_of = |j: usize| Extremity::of_name(&self.names[j]);
        let mut of: Vec<usize> = (0..self.names.len()).collect();
        let mut from_the_root = of.clone();
        from_the_root.sort_by_key(|&j| self.ancestors(j).count());
        // Fingers may hang in a forearm side by side: by kind and joint that they hang in, the first of them.
        let mut hanging = BTreeMap::new();
        for joint in from_the_root {
            let kind = self.ancestors(joint).find_map(kind_of);
            let helps = self.shares[joint] < LEAST_SHARE || is_subordinate(&self.names[joint]);
            if let Some(kind) = kind {
                let limb: Vec<usize> = self
                    .ancestors(joint)
                    .take_while(|&j| kind_of(j).is_none_or(|k| k == kind))
                    .collect();
                let top = limb
                    .iter()
                    .rposition(|&j| kind_of(j) == Some(kind))
                    .unwrap_or(0);
                let place = (kind, self.parents[limb[top]]);
                of[joint] = *hanging.entry(place).or_insert(limb[top]);
            } else if let (true, Some(parent)) = (helps, self.parents[joint]) {
                of[joint] = of[parent];
            }
        }
        of
    }

    /// Merges groups into the groups above them, the cheapest and its mirror image first, until few enough are left.
    fn merge_cheapest(&self, of: &mut [usize]) {
        let is_hand = |name: &String| Extremity::of_name(name) == Some(Extremity::Hand);
        let most = if self.names.iter().any(is_hand) {
            RULE_GROUPS
        } else {
            RULE_GROUPS_WITHOUT_HANDS
        };
        loop {
            let mut groups = members_by_group(of);
            groups.retain(|_, members| self.surface(members) > 0.0);
            // Hands, feet and heads stay, while anything else can go.
            let mut best: Option<((bool, f32), usize, usize)> = None;
            for (&group, members) in &groups {
                let Some(into) = self.group_above(&groups, of, group) else {
                    continue;
                };
                let both = [&groups[&into][..], members].concat();
                let cost =
                    self.driver(&both).1 - self.driver(&groups[&into]).1 - self.driver(members).1;
                let small = self.surface(members) < LEAST_SHARE;
                let order = (
                    !small && Extremity::of_name(&self.names[group]).is_some(),
                    cost,
                );
                if (small || groups.len() > most) && best.is_none_or(|b| order < b.0) {
                    best = Some((order, group, into));
                }
            }
            let Some((_, group, into)) = best else { break };
            let twin = mirrored(&self.names[group])
                .and_then(|name| self.names.iter().position(|n| *n == name))
                .filter(|twin| groups.contains_key(twin) && *twin != into);
            let twin_into = twin.and_then(|t| self.group_above(&groups, of, t));
            let mut merge = |from: usize, to: usize| {
                let members = of.iter_mut().filter(|g| **g == from);
                members.for_each(|g| *g = to);
            };
            merge(group, into);
            if let (Some(twin), Some(to)) = (twin, twin_into.filter(|&to| to != group)) {
                merge(twin, to);
            }
        }
    }

    fn surface(&self, members: &[usize]) -> f64 {
        members.iter().map(|&j| self.shares[j]).sum()
    }

    /// The group with surface that holds the nearest joint above; the largest one for a group that hangs in none.
    fn group_above(
        &self,
        groups: &BTreeMap<usize, Vec<usize>>,
        of: &[usize],
        group: usize,
    ) -> Option<usize> {
        let other = |g: &usize| *g != group && groups.contains_key(g);
        let above = groups[&group]
            .iter()
            .find_map(|&j| self.ancestors(j).map(|a| of[a]).find(other));
        let largest = || {
            let others = groups.iter().filter(|(g, _)| other(g));
            others
                .max_by(|a, b| self.surface(a.1).total_cmp(&self.surface(b.1)))
                .map(|(g, _)| *g)
        };
        above.or_else(largest)
    }

    /// Numbers the groups that have surface; the rest of the joints go with the first group above or below them.
    fn finish(&self, of: &[usize], names: Option<&[String]>) -> Groups {
        let groups: BTreeMap<usize, Vec<usize>> = members_by_group(of);
        let mut numbers = BTreeMap::new();
        let mut out = Vec::new();
        for (&group, members) in groups.iter().filter(|(_, m)| self.surface(m) > 0.0) {
            let driver = self.driver(members).0;
            let is_word = |j: &usize| Extremity::of_name(&self.names[*j]) == Some(Extremity::Head);
            let (name, is_head) = match names {
                Some(names) => (
                    names[group].clone(),
                    names[group].to_lowercase().contains("head"),
                ),
                None => (self.names[driver].clone(), is_word(&driver)),
            };
            numbers.insert(group, out.len() as u8);
            out.push(Group {
                name: if name.is_empty() {
                    format!("joint {driver}")
                } else {
                    name
                },
                driver: driver as u32,
                is_head,
            });
        }
        if out.is_empty() {
            out.push(Group {
                name: "body".into(),
                driver: 0,
                is_head: false,
            });
        }
        let number = |j: usize| {
            let above = self.ancestors(j).find_map(|a| numbers.get(&of[a]));
            above.copied().unwrap_or(0)
        };
        Groups {
            of_joint: (0..of.len()).map(number).collect(),
            groups: out,
        }
    }
}

/// What following `follows` in place of `joint` costs in the poses.
fn clip_motion(moments: &Mat4, poses: &[Vec<Affine3A>], joint: usize, follows: usize) -> f32 {
    let mut sum = 0.0;
    for pose in poses {
        let (a, b) = (Mat4::from(pose[joint]), Mat4::from(pose[follows]));
        let difference = (a - b).transpose();
        for row in [difference.x_axis, difference.y_axis, difference.z_axis] {
            sum += row.dot(*moments * row);
        }
    }
    (sum / poses.len().max(1) as f32).max(0.0)
}

/// What a rotation about the joint's place costs.
fn free_motion(moments: &Mat4, place: Vec3, rotation: f32) -> f32 {
    let (first, share) = (moments.w_axis.truncate(), moments.w_axis.w);
    let spread = moments.x_axis.x + moments.y_axis.y + moments.z_axis.z - 2.0 * first.dot(place)
        + share * place.length_squared();
    rotation * rotation * spread.max(0.0)
}

fn members_by_group(of: &[usize]) -> BTreeMap<usize, Vec<usize>> {
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (joint, &group) in of.iter().enumerate() {
        groups.entry(group).or_default().push(joint);
    }
    groups
}

fn outer(v: Vec4) -> Mat4 {
    Mat4::from_cols(v * v.x, v * v.y, v * v.z, v * v.w)
}

/// What keeps all that hangs in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Extremity {
    Hand,
    Foot,
    Head,
}

impl Extremity {
    fn of_name(name: &str) -> Option<Self> {
        const HAND: &[&str] = &[
            "hand",
            "wrist",
            "palm",
            "finger",
            "fingers",
            "thumb",
            "pinky",
            "metacarpal",
            "handslot",
        ];
        // Fingers only where no other part of the body is named.
        const FINGER: &[&str] = &["index", "middle", "ring"];
        const BESIDE: &[&str] = &["l", "r", "left", "right", "f", "b", "def"];
        const FOOT: &[&str] = &[
            "foot", "feet", "toe", "toes", "ankle", "ball", "hoof", "paw",
        ];
        const HEAD: &[&str] = &[
            "head", "jaw", "skull", "ear", "eye", "brow", "mouth", "nose", "tongue", "lip", "cheek",
        ];
        let words = words(name);
        // Controls steer joints and are not part of a limb.
        if words
            .iter()
            .any(|w| ["ik", "control", "poletarget", "pole"].contains(&w.as_str()))
        {
            return None;
        }
        let says = |list: &[&str]| words.iter().any(|w| list.contains(&w.as_str()));
        let is_finger = says(FINGER)
            && words
                .iter()
                .all(|w| [FINGER, BESIDE].concat().contains(&w.as_str()));
        if says(HEAD) {
            Some(Self::Head)
        } else if (says(HAND) || is_finger) && !says(&["forearm", "arm", "lowerarm"]) {
            Some(Self::Hand)
        } else if says(FOOT) {
            Some(Self::Foot)
        } else {
            None
        }
    }
}

/// The joint that each joint goes with, because it is a part of the same hand, foot or head, a helper or without surface;
/// others go with themselves. `shares` are the joints' shares of the surface.
pub(crate) fn grouped_by_name(nodes: &[Node], joints: &[Joint], shares: Vec<f64>) -> Vec<usize> {
    let name_of = |j: &Joint| nodes.get(j.node as usize).map(|n| n.name.clone());
    Joints {
        names: joints
            .iter()
            .map(|j| name_of(j).unwrap_or_default())
            .collect(),
        parents: super::pose::joint_parents(nodes, joints),
        shares,
        misplaced: Vec::new(),
    }
    .merged_by_name()
}

/// Whether each joint is one of such an extremity, or hangs in one, by names.
pub(crate) fn hanging_in(extremity: Extremity, nodes: &[Node], joints: &[Joint]) -> Vec<bool> {
    let hangs = |joint: &Joint| {
        let mut node = nodes.get(joint.node as usize);
        // A valid skeleton has no circle; nobody has to rely on it.
        for _ in 0..nodes.len() {
            let Some(n) = node else { break };
            if Extremity::of_name(&n.name) == Some(extremity) {
                return true;
            }
            node = n.parent.and_then(|p| nodes.get(p as usize));
        }
        false
    };
    joints.iter().map(hangs).collect()
}

/// The joint only helps its parent: twist and leaf joints.
fn is_subordinate(name: &str) -> bool {
    const WORDS: &[&str] = &[
        "twist", "roll", "helper", "leaf", "end", "nub", "tip", "correct",
    ];
    words(name).iter().any(|w| WORDS.contains(&w.as_str()))
}

/// The joint turns an upper or lower arm or leg.
fn is_limb(name: &str) -> bool {
    const WORDS: &[&str] = &[
        "arm", "upperarm", "forearm", "lowerarm", "elbow", "leg", "upperleg", "upleg", "lowerleg",
        "thigh", "shin", "calf", "knee",
    ];
    words(name).iter().any(|w| WORDS.contains(&w.as_str()))
}

/// The name of the joint on the other side, where the name says a side.
fn mirrored(name: &str) -> Option<String> {
    for (left, right) in [("Left", "Right"), ("left", "right")] {
        for (a, b) in [(left, right), (right, left)] {
            if name.contains(a) {
                return Some(name.replace(a, b));
            }
        }
    }
    let flip = |c: char| match c {
        'l' => Some('r'),
        'r' => Some('l'),
        'L' => Some('R'),
        'R' => Some('L'),
        _ => None,
    };
    // A side letter stands alone: `upper_arm.L`, `l_hand`, `thigh_l`.
    let chars: Vec<char> = name.chars().collect();
    let alone = |i: usize| {
        let edge = |c: Option<&char>| c.is_none_or(|c| !c.is_alphanumeric());
        edge(i.checked_sub(1).and_then(|i| chars.get(i))) && edge(chars.get(i + 1))
    };
    let at = (0..chars.len()).find(|&i| flip(chars[i]).is_some() && alone(i))?;
    let mut out = chars.clone();
    out[at] = flip(chars[at])?;
    Some(out.into_iter().collect())
}
