//! Animation clips: keys interpolated stepwise, linearly (rotations spherically) or by cubic splines.

use gltf::json::Root;
use gltf::json::animation::{Animation, Channel, Interpolation, Property};
use gltf::json::validation::Checked;
use salient_sdk::NodeError;

use super::accessor::Buffers;
use super::pose::Scene;
use super::{FORMAT, bad};

/// How far past a clip's last key a time may be, in seconds: files round their key times.
const SLACK: f64 = 1e-3;

/// Moves the nodes of a scene to where a clip has them at a time. Before the first key of a channel its first value holds,
/// after its last key the last; a time past the last key of all is an error.
pub fn apply(scene: &mut Scene, root: &Root, buffers: &Buffers, name: &str, time: f64) -> Result<(), NodeError> {
    let (index, clip) = find(root, name)?;
    let mut samplers = Vec::new();
    for (i, sampler) in clip.samplers.iter().enumerate() {
        let place = format!("animation {index}, sampler {i}");
        let times = buffers.read(root, sampler.input, 1, &place)?;
        if times.is_empty() || !times.is_sorted_by(|a, b| a < b) || !times.iter().all(|t| t.is_finite()) {
            return Err(bad(FORMAT, place, "key times do not increase"));
        }
        samplers.push(times);
    }
    let end = samplers.iter().filter_map(|t| t.last()).fold(0.0, |a: f64, b| a.max(*b));
    if !(0.0..=end + SLACK).contains(&time) {
        return Err(NodeError::new(format!("{FORMAT}: time {time} s is outside the clip `{name}`"))
            .help(format!("the clip runs from 0 to {end} s")));
    }
    for (i, channel) in clip.channels.iter().enumerate() {
        let place = format!("animation {index}, channel {i}");
        let times = samplers
            .get(channel.sampler.value())
            .ok_or_else(|| bad(FORMAT, &place, "names a sampler that is not there"))?;
        move_node(scene, root, buffers, &Keyed { clip, channel, times, place: &place }, time)?;
    }
    Ok(())
}

/// The clip of a name; clips without one are called by their index.
fn find<'a>(root: &'a Root, name: &str) -> Result<(usize, &'a Animation), NodeError> {
    let called = |i: usize, clip: &Animation| clip.name.clone().unwrap_or_else(|| format!("Anim_{i}"));
    let clips = || root.animations.iter().enumerate();
    let found: Vec<_> = clips().filter(|(i, clip)| called(*i, clip) == name).collect();
    match found[..] {
        [one] => Ok(one),
        [] => {
            let all: Vec<_> = clips().map(|(i, clip)| format!("`{}`", called(i, clip))).collect();
            let all = if all.is_empty() { "none".into() } else { all.join(", ") };
            Err(NodeError::new(format!("{FORMAT}: no clip is called `{name}`"))
                .help(format!("clips of the file: {all}")))
        }
        _ => Err(NodeError::new(format!("{FORMAT}: {} clips are called `{name}`", found.len()))),
    }
}

struct Keyed<'a> {
    clip: &'a Animation,
    channel: &'a Channel,
    times: &'a [f64],
    place: &'a str,
}

fn move_node(scene: &mut Scene, root: &Root, buffers: &Buffers, keyed: &Keyed, time: f64) -> Result<(), NodeError> {
    let at = |what: String| bad(FORMAT, keyed.place, what);
    let target = &keyed.channel.target;
    let node = target.node.value();
    let Checked::Valid(path) = target.path else {
        return Err(at("moves a property that is not known".into()));
    };
    let mesh = root.nodes.get(node).ok_or_else(|| at(format!("moves node {node}, which is not there")))?.mesh;
    // Morph weights are stored as scalars, one run for all targets to a key.
    let (stored, width) = match path {
        Property::Translation | Property::Scale => (3, 3),
        Property::Rotation => (4, 4),
        Property::MorphTargetWeights => {
            let primitives = mesh.and_then(|m| root.get(m)).map(|m| &m.primitives);
            let targets = primitives.and_then(|p| p.first()).and_then(|p| p.targets.as_ref());
            (1, targets.map_or(0, Vec::len))
        }
    };
    let sampler = &keyed.clip.samplers[keyed.channel.sampler.value()];
    let Checked::Valid(interpolation) = sampler.interpolation else {
        return Err(at("interpolates in a way that is not known".into()));
    };
    let values = buffers.read(root, sampler.output, stored, keyed.place)?;
    let runs = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    if values.len() != keyed.times.len() * runs * width {
        let (n, keys) = (values.len(), keyed.times.len());
        return Err(at(format!("{n} numbers for {keys} keys of {width}")));
    }
    let value = sample(interpolation, keyed.times, &values, width, path == Property::Rotation, time);
    let local = &mut scene.locals[node];
    if local.matrix.is_some() && path != Property::MorphTargetWeights {
        return Err(at(format!("moves node {node}, whose transform is a matrix")));
    }
    match (path, &value[..]) {
        (Property::Translation, &[x, y, z]) => local.translation = [x, y, z],
        (Property::Scale, &[x, y, z]) => local.scale = [x, y, z],
        (Property::Rotation, &[x, y, z, w]) if value.iter().any(|c| *c != 0.0) => {
            local.rotation = [x, y, z, w];
        }
        (Property::MorphTargetWeights, _) => local.morph = Some(value),
        _ => return Err(at("the rotation is the zero quaternion".into())),
    }
    Ok(())
}

/// The value of a channel at a time: `width` numbers, a quaternion (not of unit length) if `rotates`.
fn sample(
    interpolation: Interpolation,
    times: &[f64],
    values: &[f64],
    width: usize,
    rotates: bool,
    time: f64,
) -> Vec<f64> {
    let spline = interpolation == Interpolation::CubicSpline;
    // A spline's key is an in-tangent, a value and an out-tangent.
    let run = |key: usize, part: usize| {
        let start = if spline { 3 * key + part } else { key };
        &values[start * width..(start + 1) * width]
    };
    let after = times.partition_point(|t| *t <= time);
    if after == 0 || after == times.len() {
        return run(after.saturating_sub(1), 1).to_vec();
    }
    let (a, b) = (run(after - 1, 1), run(after, 1));
    let span = times[after] - times[after - 1];
    let s = (time - times[after - 1]) / span;
    match interpolation {
        Interpolation::Step => a.to_vec(),
        Interpolation::Linear if rotates => slerp(a, b, s),
        Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a + s * (b - a)).collect(),
        Interpolation::CubicSpline => {
            let (out, into) = (run(after - 1, 2), run(after, 0));
            let (s2, s3) = (s * s, s * s * s);
            let hermite = |i: usize| {
                (2.0 * s3 - 3.0 * s2 + 1.0) * a[i]
                    + span * (s3 - 2.0 * s2 + s) * out[i]
                    + (3.0 * s2 - 2.0 * s3) * b[i]
                    + span * (s3 - s2) * into[i]
            };
            (0..width).map(hermite).collect()
        }
    }
}

/// Spherical interpolation along the shorter arc.
fn slerp(a: &[f64], b: &[f64], s: f64) -> Vec<f64> {
    let length = |q: &[f64]| q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let (na, nb) = (length(a), length(b));
    let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / (na * nb);
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    let angle = dot.abs().min(1.0).acos();
    // For tiny angles the sines cancel; the straight line is then the arc to rounding.
    let (wa, wb) = if angle < 1e-6 {
        (1.0 - s, s)
    } else {
        (((1.0 - s) * angle).sin() / angle.sin(), (s * angle).sin() / angle.sin())
    };
    a.iter().zip(b).map(|(a, b)| wa * a / na + sign * wb * b / nb).collect()
}
