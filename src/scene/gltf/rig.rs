//! The tree of nodes and the animation that moves it.

use super::data::Data;
use glam::{DMat4, DQuat, DVec3};
use gltf::{
    accessor::Dimensions,
    animation::{Interpolation, Property},
};
use std::collections::BTreeMap;

/// More nodes than this are no scene that can be drawn: each object takes its matrices along in every frame.
const MAX_NODES: usize = 1 << 16;

/// Nodes with their parents and what moves them.
pub struct Rig {
    nodes: Vec<Node>,
    /// Nodes of the scene, each after its parent.
    pub order: Vec<usize>,
}

struct Node {
    parent: Option<usize>,
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
    /// Weights of its mesh's morph targets.
    weights: Vec<f64>,
    tracks: Vec<Track>,
}

/// What one property of a node does over time.
struct Track {
    property: Property,
    interpolation: Interpolation,
    /// Seconds, rising.
    times: Vec<f64>,
    /// `n` numbers a key; of a cubic spline the tangent before, the value and the tangent after.
    values: Vec<f64>,
    n: usize,
}

impl Rig {
    /// The nodes of the file's default scene, else of its first, moved by one of its animations.
    pub fn new(data: &Data, animation: Option<&str>) -> Result<Self, String> {
        let document = &data.document;
        let n_nodes = document.nodes().len();
        if n_nodes > MAX_NODES {
            return Err(format!("has {n_nodes} nodes; at most {MAX_NODES} can be rendered"));
        }
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let scene = scene.ok_or("has no scene")?;
        let mut nodes: Vec<Node> = document.nodes().map(|node| Node::new(&node)).collect();
        let mut is_known = vec![false; n_nodes];
        let mut order = Vec::with_capacity(n_nodes);
        let mut waiting: Vec<_> = scene.nodes().map(|node| (node, None)).collect();
        while let Some((node, parent)) = waiting.pop() {
            if std::mem::replace(&mut is_known[node.index()], true) {
                return Err(format!("node {} has two parents, or is its own", node.index()));
            }
            nodes[node.index()].parent = parent;
            order.push(node.index());
            waiting.extend(node.children().map(|child| (child, Some(node.index()))));
        }
        if let Some(error) = nodes.iter().position(|node| !node.is_finite()) {
            return Err(format!("node {error} has a transform that is not finite"));
        }
        let mut rig = Self { nodes, order };
        rig.animate(data, animation)?;
        Ok(rig)
    }

    fn animate(&mut self, data: &Data, wanted: Option<&str>) -> Result<(), String> {
        let mut all = data.document.animations();
        let names = || {
            let names = data.document.animations().map(|animation| match animation.name() {
                Some(name) => format!("`{name}`"),
                None => animation.index().to_string(),
            });
            names.collect::<Vec<_>>().join(", ")
        };
        let found = match wanted {
            None => all.next(),
            Some(wanted) => {
                let is_it = |animation: &gltf::Animation<'_>| {
                    animation.name() == Some(wanted) || wanted.parse() == Ok(animation.index())
                };
                Some(
                    all.find(is_it)
                        .ok_or_else(|| format!("has no animation `{wanted}`; there are: {}", names()))?,
                )
            }
        };
        for channel in found.iter().flat_map(gltf::Animation::channels) {
            let node = channel.target().node().index();
            let track = Track::new(data, &channel)
                .map_err(|error| format!("animation {}, node {node}: {error}", channel.animation().index()))?;
            self.nodes[node].tracks.push(track);
        }
        Ok(())
    }

    /// The root of a node's place: itself, its parent and so on.
    fn line(&self, node: usize) -> impl Iterator<Item = &Node> {
        std::iter::successors(Some(&self.nodes[node]), |node| Some(&self.nodes[node.parent?]))
    }

    /// Whether the node's place in the world changes.
    pub fn moves(&self, node: usize) -> bool {
        let moves = |track: &Track| track.property != Property::MorphTargetWeights;
        self.line(node).any(|node| node.tracks.iter().any(moves))
    }

    /// World from the node's own space, at `seconds`.
    pub fn world(&self, node: usize, seconds: f64) -> DMat4 {
        self.line(node)
            .fold(DMat4::IDENTITY, |below, node| node.local(seconds) * below)
    }

    /// Weights of the morph targets of a node's mesh, where the node has any.
    pub fn weights(&self, node: usize, seconds: f64) -> Vec<f64> {
        let node = &self.nodes[node];
        let track = node
            .tracks
            .iter()
            .find(|track| track.property == Property::MorphTargetWeights);
        track.map_or_else(|| node.weights.clone(), |track| track.at(seconds))
    }
}

impl Node {
    fn new(node: &gltf::Node<'_>) -> Self {
        let (translation, rotation, scale) = node.transform().decomposed();
        let weights = node.weights().or_else(|| node.mesh().and_then(|mesh| mesh.weights()));
        Self {
            parent: None,
            translation: DVec3::from_array(translation.map(f64::from)),
            rotation: DQuat::from_array(rotation.map(f64::from)),
            scale: DVec3::from_array(scale.map(f64::from)),
            weights: weights
                .unwrap_or_default()
                .iter()
                .map(|weight| f64::from(*weight))
                .collect(),
            tracks: Vec::new(),
        }
    }

    fn is_finite(&self) -> bool {
        self.translation.is_finite() && self.rotation.is_finite() && self.scale.is_finite()
    }

    fn local(&self, seconds: f64) -> DMat4 {
        let (mut translation, mut rotation, mut scale) = (self.translation, self.rotation, self.scale);
        for track in &self.tracks {
            match (track.property, track.at(seconds).as_slice()) {
                (Property::Translation, value) => translation = DVec3::from_slice(value),
                (Property::Scale, value) => scale = DVec3::from_slice(value),
                (Property::Rotation, value) => rotation = DQuat::from_slice(value),
                (Property::MorphTargetWeights, _) => {}
            }
        }
        DMat4::from_scale_rotation_translation(scale, rotation.normalize(), translation)
    }
}

impl Track {
    fn new(data: &Data, channel: &gltf::animation::Channel<'_>) -> Result<Self, String> {
        let sampler = channel.sampler();
        let (property, interpolation) = (channel.target().property(), sampler.interpolation());
        let times = data.numbers(&sampler.input(), Dimensions::Scalar)?;
        if times.is_empty() || times.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err("its times do not rise".to_owned());
        }
        let dimensions = match property {
            Property::Translation | Property::Scale => Dimensions::Vec3,
            Property::Rotation => Dimensions::Vec4,
            Property::MorphTargetWeights => Dimensions::Scalar,
        };
        let values = data.numbers(&sampler.output(), dimensions)?;
        let n_keys = times.len()
            * if interpolation == Interpolation::CubicSpline {
                3
            } else {
                1
            };
        let n = match property {
            Property::MorphTargetWeights => values.len() / n_keys,
            _ => dimensions.multiplicity(),
        };
        if n == 0 || values.len() != n * n_keys {
            return Err(format!("has {} times and {} numbers", times.len(), values.len()));
        }
        Ok(Self {
            property,
            interpolation,
            times: times.into_iter().map(f64::from).collect(),
            values: values.into_iter().map(f64::from).collect(),
            n,
        })
    }

    /// One of the parts of key `i`.
    fn part(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }

    /// Before the first key and after the last, what they say.
    fn at(&self, seconds: f64) -> Vec<f64> {
        let is_cubic = self.interpolation == Interpolation::CubicSpline;
        let value = |key: usize| self.part(if is_cubic { 3 * key + 1 } else { key });
        let after = self.times.partition_point(|time| *time <= seconds);
        if after == 0 || after == self.times.len() {
            return value(after.saturating_sub(1)).to_vec();
        }
        let key = after - 1;
        let length = self.times[after] - self.times[key];
        let t = (seconds - self.times[key]) / length;
        let (a, b) = (value(key), value(after));
        match self.interpolation {
            Interpolation::Step => a.to_vec(),
            Interpolation::Linear if self.property == Property::Rotation => {
                let [a, b] = [a, b].map(|value| DQuat::from_slice(value).normalize());
                a.slerp(b, t).to_array().to_vec()
            }
            Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a + (b - a) * t).collect(),
            Interpolation::CubicSpline => {
                let (leaving, arriving) = (self.part(3 * key + 2), self.part(3 * after));
                let (t2, t3) = (t * t, t * t * t);
                let weights = [
                    2.0 * t3 - 3.0 * t2 + 1.0,
                    length * (t3 - 2.0 * t2 + t),
                    3.0 * t2 - 2.0 * t3,
                    length * (t3 - t2),
                ];
                (0..self.n)
                    .map(|i| weights[0] * a[i] + weights[1] * leaving[i] + weights[2] * b[i] + weights[3] * arriving[i])
                    .collect()
            }
        }
    }
}

/// Names by which cameras can be asked for, with their nodes.
pub fn cameras(data: &Data, rig: &Rig) -> BTreeMap<String, usize> {
    let nodes: Vec<_> = data.document.nodes().collect();
    let mut named = BTreeMap::new();
    for &index in &rig.order {
        if let Some(camera) = nodes[index].camera() {
            let name = nodes[index].name().or(camera.name());
            named.insert(name.map_or_else(|| camera.index().to_string(), str::to_owned), index);
        }
    }
    named
}
