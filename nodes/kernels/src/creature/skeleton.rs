//! The bones of a creature: proportions of species and individual, joints and their ranges.
//!
//! Axes: x to the left-right, y up, z forward; the torso is about one unit long. Angles are in degrees.

use super::skin::Motion;
use crate::random::Random;
use crate::vec3::{add, distance, lerp, scale};

/// A kind of creature: a set of proportions. Shapes of one species and different seeds are individuals of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord, Hash)]
pub enum Species {
    /// Long tail, round head, pointed ears.
    #[default]
    Cat,
    /// Long legs, strong neck, long head, hanging tail.
    Horse,
    /// Heavy, short-necked, hardly any tail.
    Bear,
    /// Very long legs and neck.
    Giraffe,
    /// Flat, splayed legs, no ears, thick tail.
    Lizard,
}

impl Species {
    /// All of them, in order.
    pub const ALL: [Self; 5] = [Self::Cat, Self::Horse, Self::Bear, Self::Giraffe, Self::Lizard];
}

/// Lengths and radii in torso lengths; `rise` angles in degrees above the horizontal.
#[derive(Clone, Copy)]
struct Proportions {
    height: f64,
    chest: f64,
    rump: f64,
    leg: f64,
    ankle: f64,
    stance: f64,
    splay: f64,
    neck_length: f64,
    neck_rise: f64,
    neck: f64,
    head_length: f64,
    head: f64,
    snout_length: f64,
    snout: f64,
    ear_length: f64,
    ear: f64,
    tail_length: f64,
    tail: f64,
    tail_rise: f64,
}

#[rustfmt::skip] // One line per group of parts is easier to compare between species.
fn proportions(species: Species) -> Proportions {
    match species {
        Species::Cat => Proportions {
            height: 0.55, chest: 0.17, rump: 0.165, leg: 0.095, ankle: 0.052, stance: 0.12, splay: 0.01,
            neck_length: 0.22, neck_rise: 50.0, neck: 0.10, head_length: 0.10, head: 0.13, snout_length: 0.12, snout: 0.065,
            ear_length: 0.14, ear: 0.048, tail_length: 0.85, tail: 0.052, tail_rise: 20.0,
        },
        Species::Horse => Proportions {
            height: 0.85, chest: 0.21, rump: 0.215, leg: 0.115, ankle: 0.056, stance: 0.14, splay: 0.01,
            neck_length: 0.52, neck_rise: 52.0, neck: 0.125, head_length: 0.20, head: 0.11, snout_length: 0.20, snout: 0.075,
            ear_length: 0.10, ear: 0.040, tail_length: 0.55, tail: 0.065, tail_rise: -42.0,
        },
        Species::Bear => Proportions {
            height: 0.58, chest: 0.27, rump: 0.28, leg: 0.135, ankle: 0.085, stance: 0.20, splay: 0.01,
            neck_length: 0.22, neck_rise: 25.0, neck: 0.18, head_length: 0.14, head: 0.165, snout_length: 0.15, snout: 0.085,
            ear_length: 0.08, ear: 0.055, tail_length: 0.20, tail: 0.075, tail_rise: 10.0,
        },
        Species::Giraffe => Proportions {
            height: 1.10, chest: 0.22, rump: 0.20, leg: 0.10, ankle: 0.055, stance: 0.145, splay: 0.01,
            neck_length: 1.10, neck_rise: 66.0, neck: 0.12, head_length: 0.16, head: 0.09, snout_length: 0.18, snout: 0.065,
            ear_length: 0.12, ear: 0.038, tail_length: 0.50, tail: 0.048, tail_rise: -50.0,
        },
        Species::Lizard => Proportions {
            height: 0.26, chest: 0.15, rump: 0.14, leg: 0.065, ankle: 0.045, stance: 0.16, splay: 0.17,
            neck_length: 0.18, neck_rise: 12.0, neck: 0.10, head_length: 0.12, head: 0.11, snout_length: 0.15, snout: 0.065,
            ear_length: 0.0, ear: 0.0, tail_length: 1.20, tail: 0.085, tail_rise: -2.0,
        },
    }
}

impl Proportions {
    /// An individual: each measure up to 12 % more or less, each angle up to 4 degrees.
    fn varied(mut self, seed: u64, species: Species) -> Self {
        let mut random = Random::new(&[seed, species as u64, 1]);
        for measure in [
            &mut self.height,
            &mut self.chest,
            &mut self.rump,
            &mut self.leg,
            &mut self.ankle,
            &mut self.neck_length,
            &mut self.neck,
            &mut self.head_length,
            &mut self.head,
            &mut self.snout_length,
            &mut self.snout,
            &mut self.ear_length,
            &mut self.tail_length,
            &mut self.tail,
        ] {
            *measure *= 1.0 + 0.12 * random.signed();
        }
        self.neck_rise += 4.0 * random.signed();
        self.tail_rise += 4.0 * random.signed();
        self
    }
}

/// A bone: a capsule of two radii, turning about its start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bone {
    /// The bone it hangs on; itself for the root.
    pub(super) parent: usize,
    pub(super) start: [f64; 3],
    pub(super) end: [f64; 3],
    pub(super) radius: [f64; 2],
    /// Lowest and highest turn about x, y and z, in degrees.
    range: [[f64; 2]; 3],
}

/// The skeleton at rest, and named points near the surface.
#[derive(Debug, Clone)]
pub(super) struct Skeleton {
    pub(super) bones: Vec<Bone>,
    pub(super) landmarks: Vec<(&'static str, [f64; 3])>,
}

fn both(x: f64) -> [f64; 2] {
    [-x, x]
}

/// A unit vector in the sagittal plane: `angle` degrees above forward.
fn heading(angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.to_radians().sin_cos();
    [0.0, sin, cos]
}

impl Skeleton {
    /// The skeleton of an individual at rest. It is symmetric about x = 0, bone by bone.
    pub(super) fn new(species: Species, seed: u64) -> Self {
        let p = proportions(species).varied(seed, species);
        let mut skeleton = Self { bones: Vec::new(), landmarks: Vec::new() };
        let hips =
            skeleton.bone(None, [0.0, p.height, -0.4], [0.0, p.height, 0.0], [p.rump, 0.93 * p.chest], [[0.0; 2]; 3]);
        let range = [both(8.0), both(12.0), both(6.0)];
        let chest =
            skeleton.bone(Some(hips), [0.0, p.height, 0.0], [0.0, p.height, 0.4], [0.93 * p.chest, p.chest], range);
        skeleton.landmarks.push(("back", [0.0, p.height + p.chest, 0.0]));
        skeleton.landmarks.push(("belly", [0.0, p.height - p.chest, 0.0]));
        skeleton.head(&p, chest);
        skeleton.tail(&p, hips);
        skeleton.legs(&p, chest, true);
        skeleton.legs(&p, hips, false);
        skeleton
    }

    fn bone(
        &mut self,
        parent: Option<usize>,
        start: [f64; 3],
        end: [f64; 3],
        radius: [f64; 2],
        range: [[f64; 2]; 3],
    ) -> usize {
        let index = self.bones.len();
        self.bones.push(Bone { parent: parent.unwrap_or(index), start, end, radius, range });
        index
    }

    fn head(&mut self, p: &Proportions, chest: usize) {
        let base = [0.0, p.height + 0.3 * p.chest, 0.4 + 0.3 * p.chest];
        let nape = add(base, scale(heading(p.neck_rise), p.neck_length));
        let range = [both(20.0), both(22.0), both(8.0)];
        let neck = self.bone(Some(chest), base, nape, [1.15 * p.neck, 0.85 * p.neck], range);
        let brow = add(nape, scale(heading(0.3 * p.neck_rise - 20.0), p.head_length));
        let range = [both(18.0), both(20.0), both(10.0)];
        let head = self.bone(Some(neck), nape, brow, [p.head, 0.85 * p.head], range);
        let ahead = heading(0.3 * p.neck_rise - 32.0);
        let nose = add(brow, scale(ahead, p.snout_length));
        self.bone(Some(head), brow, nose, [1.1 * p.snout, 0.85 * p.snout], [[0.0; 2]; 3]);
        self.landmarks.push(("nose", add(nose, scale(ahead, p.snout))));
        if p.ear_length <= 0.0 {
            return;
        }
        for (side, name) in [(1.0, "ear +x"), (-1.0, "ear -x")] {
            let root = add(nape, [side * 0.5 * p.head, 0.6 * p.head, 0.0]);
            let tip = add(root, [side * 0.35 * p.ear_length, p.ear_length + 0.3 * p.head, 0.0]);
            self.bone(Some(head), root, tip, [1.1 * p.ear, 0.75 * p.ear], [both(8.0), both(5.0), both(8.0)]);
            self.landmarks.push((name, add(tip, [0.0, p.ear, 0.0])));
        }
    }

    fn tail(&mut self, p: &Proportions, hips: usize) {
        // Backward is forward turned by half a circle.
        let along = heading(180.0 - p.tail_rise);
        let base = [0.0, p.height + 0.4 * p.rump, -0.4 - 0.5 * p.rump];
        let joints = [0.0, 1.0, 2.0, 3.0].map(|k| add(base, scale(along, 0.5 * p.rump + p.tail_length * k / 3.0)));
        let mut parent = hips;
        for k in 0..3 {
            let start = if k == 0 { base } else { joints[k] };
            let radius = [1.0, 0.9, 0.8, 0.7].map(|f| f * p.tail);
            parent = self.bone(
                Some(parent),
                start,
                joints[k + 1],
                [radius[k], radius[k + 1]],
                [both(18.0), both(28.0), [0.0; 2]],
            );
        }
        self.landmarks.push(("tail", add(joints[3], scale(along, 0.7 * p.tail))));
    }

    fn legs(&mut self, p: &Proportions, parent: usize, front: bool) {
        let (z, knee_z, radius, names) = if front {
            (0.38, -0.03, 0.9 * p.leg, [("front paw +x", "elbow +x"), ("front paw -x", "elbow -x")])
        } else {
            (-0.40, 0.05, p.leg, [("hind paw +x", "knee +x"), ("hind paw -x", "knee -x")])
        };
        // The thicker the leg, the more a swing would stretch the skin about the hip.
        let swing = (1.6 / p.leg).min(20.0);
        for (side, (paw, joint)) in [1.0, -1.0].into_iter().zip(names) {
            let at = |spread: f64, y: f64, dz: f64| [side * (p.stance + spread * p.splay), y, z + dz];
            let hip = at(-0.2, p.height - 0.2 * p.chest, 0.0);
            let knee = at(0.6, 0.5 * p.height, knee_z);
            let ankle = at(1.0, 1.3 * p.ankle, -0.3 * knee_z);
            let toe = at(1.0, 1.05 * p.ankle, -0.3 * knee_z + 1.5 * p.ankle);
            let upper = self.bone(
                Some(parent),
                hip,
                knee,
                [radius, 0.5 * (radius + p.ankle)],
                [both(swing), [0.0; 2], both(5.0)],
            );
            let lower = self.bone(
                Some(upper),
                knee,
                ankle,
                [0.5 * (radius + p.ankle), p.ankle],
                [[-6.0, 32.0], [0.0; 2], [0.0; 2]],
            );
            self.bone(Some(lower), ankle, toe, [1.05 * p.ankle; 2], [both(18.0), [0.0; 2], [0.0; 2]]);
            self.landmarks.push((paw, add(toe, [0.0, 0.0, p.ankle])));
            self.landmarks.push((joint, add(knee, [0.0, 0.0, radius.copysign(knee_z)])));
        }
    }

    /// The motion of each bone in a pose. Pose 0 is rest; others draw every joint from its range, and draw again, with
    /// smaller turns each time, while parts that are apart at rest run into each other.
    pub(super) fn pose(&self, pose: u32) -> Vec<Motion> {
        let rest = vec![Motion::IDENTITY; self.bones.len()];
        if pose == 0 {
            return rest;
        }
        let mut random = Random::new(&[u64::from(pose), 2]);
        for attempt in 0..64 {
            let amplitude = 1.0 - f64::from(attempt) / 64.0;
            let motions = self.drawn(&mut random, amplitude);
            if !self.collides(&motions) {
                return motions;
            }
        }
        rest
    }

    fn drawn(&self, random: &mut Random, amplitude: f64) -> Vec<Motion> {
        let mut motions: Vec<Motion> = Vec::with_capacity(self.bones.len());
        for (index, bone) in self.bones.iter().enumerate() {
            let mut motion = if bone.parent == index { Motion::IDENTITY } else { motions[bone.parent] };
            for (axis, [low, high]) in bone.range.into_iter().enumerate() {
                let angle = amplitude * (low + (high - low) * random.unit());
                motion = motion.after(&Motion::turn(axis, angle.to_radians(), bone.start));
            }
            motions.push(motion);
        }
        motions
    }

    /// Whether two parts come closer than their radii and a margin allow, other than parts that are close at rest.
    fn collides(&self, motions: &[Motion]) -> bool {
        const MARGIN: f64 = 1.2;
        let samples: Vec<([f64; 3], [f64; 3], f64)> = (self.bones.iter().zip(motions))
            .flat_map(|(bone, motion)| {
                [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| {
                    let rest = lerp(bone.start, bone.end, t);
                    (rest, motion.apply(rest), bone.radius[0] + t * (bone.radius[1] - bone.radius[0]))
                })
            })
            .collect();
        samples.iter().enumerate().any(|(i, &(rest, posed, r))| {
            samples[..i].iter().any(|&(other_rest, other, s)| {
                let reach = MARGIN * (r + s);
                distance(posed, other) < reach && distance(rest, other_rest) > 1.3 * reach
            })
        })
    }
}
