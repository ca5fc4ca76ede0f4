//! Scenes from glTF files: what moves against what the file says, and files that nobody should trust.

use crate::support::{gpu, service::reader};
use afterimage::{
    image::{Extent, Image},
    scene::{BakeSettings, BakedFrame, Baker, Clip, bake, gltf::GltfScene},
    sequence::Sequence,
};
use base64::Engine as _;
use glam::{DVec2, DVec3};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

const SIZE: Extent = Extent::new(160, 90);
/// What moves does so by this much along x, in a second and in a frame.
const SPEED: f64 = 6.0;
const STEP: f64 = SPEED / 30.0;

fn data_uri(bytes: &[u8]) -> String {
    let encoded = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{encoded}")
}

/// A file that grows: accessors are added with their bytes.
struct File {
    json: Value,
    bytes: Vec<u8>,
}

impl File {
    /// A square of side 2 at the origin that faces a camera 5 away.
    fn new() -> Self {
        let mut file = Self {
            json: json!({
                "asset": {"version": "2.0", "copyright": "CC-BY-4.0 Somebody"},
                "scene": 0,
                "scenes": [{"nodes": [0, 1]}],
                "nodes": [
                    {"mesh": 0, "name": "square"},
                    {"camera": 0, "name": "eye", "translation": [0, 0, 5]},
                ],
                "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
                "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "baseColorFactor": [0.8, 0.4, 0.2, 1.0]}}],
                "accessors": [], "bufferViews": [],
            }),
            bytes: Vec::new(),
        };
        let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let positions = file.floats("VEC3", &corners);
        let uvs = file.floats("VEC2", &[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
        let normals = file.floats("VEC3", &[[0.0, 0.0, 1.0]; 4]);
        let indices = [0_u16, 1, 2, 0, 2, 3]
            .iter()
            .flat_map(|i| i.to_le_bytes())
            .collect::<Vec<_>>();
        let indices = file.accessor("SCALAR", 5123, 6, &indices);
        file.json["meshes"] = json!([{"primitives": [{
            "attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs},
            "indices": indices, "material": 0,
        }]}]);
        file
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        let mut accessor =
            json!({"bufferView": views.len() - 1, "componentType": component, "count": count, "type": kind});
        if kind == "VEC3" {
            (accessor["min"], accessor["max"]) = (json!([-1, -1, 0]), json!([1, 1, 0]));
        }
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(accessor);
        accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, elements: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = elements.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let n = if kind == "SCALAR" {
            N * elements.len()
        } else {
            elements.len()
        };
        self.accessor(kind, 5126, n, &bytes)
    }

    /// Moves a property of a node linearly, from 0 to what it is after a second.
    fn animate<const N: usize>(&mut self, node: usize, path: &str, kind: &str, values: &[[f32; N]; 2]) {
        let input = self.floats("SCALAR", &[[0.0], [1.0]]);
        let output = self.floats(kind, values);
        self.json["animations"] = json!([{
            "name": "move",
            "samplers": [{"input": input, "output": output}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": path}}],
        }]);
    }

    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn write(&self, folder: &Path) -> PathBuf {
        let mut json = self.json.clone();
        if json.get("buffers").is_none() {
            json["buffers"] = json!([{"byteLength": self.bytes.len(), "uri": data_uri(&self.bytes)}]);
        }
        let path = folder.join("scene.gltf");
        fs::write(&path, json.to_string()).unwrap();
        path
    }
}

fn settings_of(path: &Path, camera: Option<&str>, n_frames: usize) -> Result<BakeSettings, String> {
    let gltf = GltfScene::open(path, camera, None, n_frames).map_err(|error| error.to_string())?;
    Ok(BakeSettings {
        n_frames,
        render_size: SIZE,
        output_size: SIZE,
        reference_samples: 0,
        gltf: Some(gltf),
        ..BakeSettings::new("square")
    })
}

fn frames(file: &File, n: usize) -> Vec<BakedFrame> {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings_of(&file.write(folder.path()), None, n).unwrap();
    let mut baker = Baker::new(gpu(), &settings).unwrap();
    (0..n).map(|index| baker.frame(index).unwrap()).collect()
}

fn project(camera: &Clip, point: DVec3) -> DVec2 {
    let clip = camera.from_world() * point.extend(1.0);
    let size = DVec2::new(SIZE.width.into(), SIZE.height.into());
    (DVec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5) * size
}

/// Largest error of the motion where the square is, if it came from `step` further back along x in the world.
fn error_of_motion(frame: &BakedFrame, before: &Clip, step: f64) -> f64 {
    let mut worst = (0.0_f64, 0);
    let size = DVec2::new(SIZE.width.into(), SIZE.height.into());
    let [axis, right, up] = frame.camera.rays();
    for y in 0..SIZE.height {
        for x in 0..SIZE.width {
            if frame.object_id.at(x, y) == 0 {
                continue;
            }
            let sample = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) + DVec2::from_array(frame.jitter_px);
            let ndc = DVec2::new(2.0, -2.0) * sample / size + DVec2::new(-1.0, 1.0);
            let point = frame.camera.eye() + (axis + right * ndc.x + up * ndc.y) * f64::from(frame.depth.at(x, y));
            let then = project(before, point - DVec3::X * step);
            let stored = DVec2::from_array(frame.motion_px.at(x, y).map(f64::from));
            worst = (worst.0.max((stored - (then - sample)).length()), worst.1 + 1);
        }
    }
    assert!(worst.1 > 500, "the square has {} pixels", worst.1);
    worst.0
}

#[test]
fn motion_is_what_the_file_says_whatever_moves() {
    let x = |x: f64| [x as f32, 0.0, 0.0];
    let node = {
        let mut file = File::new();
        file.animate(0, "translation", "VEC3", &[x(0.0), x(SPEED)]);
        file
    };
    let parent = {
        let mut file = File::new();
        let nodes = file.json["nodes"].as_array_mut().unwrap();
        nodes.push(json!({"children": [0]}));
        file.json["scenes"][0]["nodes"] = json!([2, 1]);
        file.animate(2, "translation", "VEC3", &[x(0.0), x(SPEED)]);
        file
    };
    let skin = {
        let mut file = File::new();
        let joints = file.accessor("VEC4", 5121, 4, &[0, 1, 0, 0].repeat(4));
        let weights = file.floats("VEC4", &[[0.25, 0.75, 0.0, 0.0]; 4]);
        let primitive = file.primitive();
        primitive["attributes"]["JOINTS_0"] = json!(joints);
        primitive["attributes"]["WEIGHTS_0"] = json!(weights);
        let nodes = file.json["nodes"].as_array_mut().unwrap();
        nodes.extend([json!({"children": [3]}), json!({})]);
        // A skinned mesh is where its joints are, not where its node is.
        nodes[0]["skin"] = json!(0);
        nodes[0]["translation"] = json!([70, 70, 70]);
        file.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
        file.json["skins"] = json!([{"joints": [2, 3]}]);
        file.animate(2, "translation", "VEC3", &[x(0.0), x(SPEED)]);
        file
    };
    let morph = {
        let mut file = File::new();
        let target = file.floats("VEC3", &[x(1.0); 4]);
        file.primitive()["targets"] = json!([{"POSITION": target}]);
        file.animate(0, "weights", "SCALAR", &[[0.0], [SPEED as f32]]);
        file
    };
    for (name, file) in [("node", node), ("parent", parent), ("skin", skin), ("morph", morph)] {
        let baked = frames(&file, 2);
        for frame in &baked {
            let error = error_of_motion(frame, &baked[0].camera, STEP);
            assert!(error < 2e-3, "{name}: {error} px");
            // The control.
            assert!(error_of_motion(frame, &baked[0].camera, 0.0) > 1.0, "{name}");
        }
    }
    let mut file = File::new();
    file.animate(1, "translation", "VEC3", &[[0.0, 0.0, 5.0], [SPEED as f32, 0.0, 5.0]]);
    let baked = frames(&file, 2);
    assert!(error_of_motion(&baked[1], &baked[0].camera, 0.0) < 2e-3);
    assert!(error_of_motion(&baked[1], &baked[1].camera, 0.0) > 1.0);
}

#[test]
fn splines_and_steps_are_where_the_format_says() {
    // Tangents of a straight line make a cubic spline of it.
    let mut file = File::new();
    let v = SPEED as f32;
    let line = [
        [v, 0.0, 0.0],
        [0.0; 3],
        [v, 0.0, 0.0],
        [v, 0.0, 0.0],
        [v, 0.0, 0.0],
        [v, 0.0, 0.0],
    ];
    file.animate(0, "translation", "VEC3", &[[0.0; 3], [v, 0.0, 0.0]]);
    file.json["animations"][0]["samplers"][0]["output"] = json!(file.floats("VEC3", &line));
    file.json["animations"][0]["samplers"][0]["interpolation"] = json!("CUBICSPLINE");
    let baked = frames(&file, 1);
    assert!(error_of_motion(&baked[0], &baked[0].camera, STEP) < 2e-3);
    file.animate(0, "translation", "VEC3", &[[0.5, 0.0, 0.0], [v, 0.0, 0.0]]);
    file.json["animations"][0]["samplers"][0]["interpolation"] = json!("STEP");
    let baked = frames(&file, 1);
    assert!(error_of_motion(&baked[0], &baked[0].camera, 0.0) < 2e-3);
}

fn center<T: Copy + Send + Sync>(image: &Image<T>) -> T {
    image.at(SIZE.width / 2, SIZE.height / 2)
}

/// The square without light, with an image on it.
fn textured(image: &image::RgbImage) -> File {
    let mut file = File::new();
    let mut png = Vec::new();
    image
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .unwrap();
    file.json["images"] = json!([{"uri": data_uri(&png).replace("octet-stream", "png"), "mimeType": "image/png"}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
    file.json["materials"][0]["extensions"] = json!({"KHR_materials_unlit": {}});
    file.json["extensionsUsed"] = json!(["KHR_materials_unlit", "KHR_texture_transform"]);
    file
}

#[test]
fn textures_turn_as_their_extension_says() {
    // Of the four quarters only the lower left is white.
    let image = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([if x < 32 && y >= 32 { 255 } else { 0 }; 3]));
    let quarters = |file: &File| {
        let frame = &frames(file, 1)[0];
        let (x, y) = (SIZE.width / 2, SIZE.height / 2);
        let color = |dx: i32, dy: i32| frame.albedo.at(x.strict_add_signed(dx), y.strict_add_signed(dy))[0] > 0.4;
        // Upper left, upper right, lower left, lower right.
        [color(-10, -10), color(10, -10), color(-10, 10), color(10, 10)]
    };
    let mut file = textured(&image);
    assert_eq!(quarters(&file), [false, false, true, false]);
    let texture = |file: &mut File, transform: Value| {
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
            json!({"KHR_texture_transform": transform});
    };
    // Coordinates turn counter-clockwise, and the image with the clock.
    texture(&mut file, json!({"rotation": std::f64::consts::FRAC_PI_2}));
    assert_eq!(quarters(&file), [true, false, false, false]);
    texture(&mut file, json!({"offset": [0.5, 0.0]}));
    assert_eq!(quarters(&file), [false, false, false, true]);
}

#[test]
fn depth_and_colour_are_those_of_the_file() {
    let frame = &frames(&File::new(), 1)[0];
    assert!((center(&frame.depth) - 5.0).abs() < 1e-5);
    assert_eq!(center(&frame.object_id), 1);
    let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 2e-3);
    assert!(
        near(center(&frame.albedo), [0.8, 0.4, 0.2]),
        "{:?}",
        center(&frame.albedo)
    );
    // Unlit, with a texture of one colour: code 188 is half of the light.
    let frame = &frames(
        &textured(&image::RgbImage::from_pixel(2, 2, image::Rgb([188, 255, 0]))),
        1,
    )[0];
    assert!(
        near(center(&frame.color), [0.4006, 0.4, 0.0]),
        "{:?}",
        center(&frame.color)
    );
}

#[test]
fn positions_may_be_whole_numbers() {
    let plain = &frames(&File::new(), 1)[0];
    let mut file = File::new();
    let corner = |x: i16, y: i16| [x, y, 0, 7].map(i16::to_le_bytes).concat();
    let max = i16::MAX;
    let corners = [
        corner(-max, -max),
        corner(max, -max),
        corner(max, max),
        corner(-max, max),
    ]
    .concat();
    let positions = file.accessor("VEC3", 5122, 4, &corners);
    file.json["accessors"][positions]["normalized"] = json!(true);
    let view = file.json["accessors"][positions]["bufferView"].as_u64().unwrap() as usize;
    file.json["bufferViews"][view]["byteStride"] = json!(8);
    file.primitive()["attributes"]["POSITION"] = json!(positions);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    let quantised = &frames(&file, 1)[0];
    assert_eq!(quantised.object_id.pixels(), plain.object_id.pixels());
}

#[test]
fn places_that_mirror_show_the_same_side() {
    let plain = &frames(&File::new(), 1)[0];
    let mut file = File::new();
    file.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let mirrored = &frames(&file, 1)[0];
    assert_eq!(center(&mirrored.object_id), 1);
    let (a, b) = (center(&plain.color), center(&mirrored.color));
    assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-4), "{a:?} {b:?}");
    // The control: from behind, a face with one side is not there.
    file.json["nodes"][0] = json!({"mesh": 0, "scale": [1, 1, -1]});
    let turned = &frames(&file, 1)[0];
    assert_eq!(center(&turned.object_id), 0);
}

#[test]
fn a_mesh_without_normals_or_indices_is_flat() {
    let plain = &frames(&File::new(), 1)[0];
    let mut file = File::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let positions = file.floats("VEC3", &corners);
    *file.primitive() = json!({"attributes": {"POSITION": positions}, "mode": 5, "material": 0});
    let strip = &frames(&file, 1)[0];
    let (a, b) = (center(&plain.color), center(&strip.color));
    assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-4), "{a:?} {b:?}");
}

fn path_json(keys: &[(f64, [f64; 3])], cuts: &[usize]) -> Value {
    let keys: Vec<_> = keys
        .iter()
        .map(|(frame, eye)| json!({"frame": frame, "eye": eye, "target": [eye[0], eye[1], 0]}))
        .collect();
    json!({"fov_y_degrees": 45.0, "keys": keys, "cuts": cuts})
}

#[test]
fn a_path_moves_the_camera_and_cuts() {
    let folder = tempfile::tempdir().unwrap();
    let file = File::new().write(folder.path());
    let path = folder.path().join("path.json");
    let keys = [(0.0, [0.0, 0.0, 5.0]), (1.0, [STEP, 0.0, 5.0]), (2.0, [0.5, 0.5, 4.0])];
    fs::write(&path, path_json(&keys, &[2]).to_string()).unwrap();
    let settings = settings_of(&file, path.to_str(), 3).unwrap();
    let mut baker = Baker::new(gpu(), &settings).unwrap();
    let baked: Vec<_> = (0..3).map(|index| baker.frame(index).unwrap()).collect();
    assert_eq!([0, 1, 2].map(|i| baked[i].reset), [true, false, true]);
    assert!((center(&baked[2].depth) - 4.0).abs() < 1e-5);
    assert!(error_of_motion(&baked[1], &baked[0].camera, 0.0) < 2e-3);
    // The frame before the first goes on as the path begins.
    assert!(error_of_motion(&baked[0], &baked[0].camera, -STEP) < 2e-3);
}

#[test]
fn paths_that_leave_frames_without_a_camera_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = File::new().write(folder.path());
    let (a, b) = ((0.0, [0.0, 0.0, 5.0]), (9.0, [1.0, 0.0, 5.0]));
    let cases = [
        (
            path_json(&[a, b], &[]),
            "its last frame is 11; add keys, or bake fewer frames",
        ),
        (
            path_json(&[a, b], &[10]),
            "there is none for the shot that begins at frame 10",
        ),
        (path_json(&[(3.0, a.1), (12.0, b.1)], &[]), "the shot begins at frame 0"),
        (path_json(&[b, a], &[]), "keys[1].frame: must be after the key before"),
        (
            path_json(&[(0.0, [0.0, 0.0, 0.0])], &[]),
            "keys[0]: needs a frame, and an eye apart",
        ),
        (
            json!({"fov_y_degrees": 45.0, "keys": [], "cats": []}),
            "unknown field `cats`",
        ),
    ];
    for (path, expected) in cases {
        let name = folder.path().join("path.json");
        fs::write(&name, path.to_string()).unwrap();
        let error = settings_of(&file, name.to_str(), 12).unwrap_err();
        assert!(error.contains(expected) && error.contains("path.json"), "{error}");
    }
    let standing = folder.path().join("one.json");
    fs::write(&standing, path_json(&[a], &[]).to_string()).unwrap();
    settings_of(&file, standing.to_str(), 12).unwrap();
    let error = settings_of(&file, Some("nose"), 2).unwrap_err();
    assert!(error.contains("has no camera `nose`; there are: `eye`"), "{error}");
}

/// Makes a mistake in a file.
type Alter = fn(&mut File);

#[test]
fn files_that_cannot_be_rendered_say_why() {
    let cases: [(Alter, &str); 11] = [
        (
            |file| file.json["buffers"] = json!([{"byteLength": 9, "uri": "gone.bin"}]),
            "buffer 0: ",
        ),
        (
            |file| file.json["buffers"] = json!([{"byteLength": 9, "uri": "https://example.org/a.bin"}]),
            "nothing is fetched from elsewhere",
        ),
        (
            |file| file.bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes()),
            "accessor 0: element 0 is not finite",
        ),
        (
            |file| file.json["accessors"][0]["count"] = json!(5),
            "accessor 0: goes beyond its buffer view",
        ),
        (
            |file| file.json["bufferViews"][0]["byteLength"] = json!(1 << 30),
            "buffer view 0 goes beyond its buffer",
        ),
        (
            |file| file.json["accessors"][0]["type"] = json!("VEC2"),
            "is of Vec2 and should be of Vec3",
        ),
        (
            |file| {
                let n = file.bytes.len();
                file.bytes[n - 2..].copy_from_slice(&4_u16.to_le_bytes());
            },
            "has 4 vertices and refers to vertex 4",
        ),
        (
            |file| file.json["nodes"] = (0..1_000_000).map(|_| json!({})).collect(),
            "has 1000000 nodes; at most 65536 can be rendered",
        ),
        (
            |file| file.json["nodes"][0]["children"] = json!([0]),
            "node 0 has two parents, or is its own",
        ),
        (
            |file| file.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
            "requires the extension KHR_draco_mesh_compression",
        ),
        (
            |file| file.json["scenes"][0]["nodes"] = json!([1]),
            "has no triangles in its scene",
        ),
    ];
    for (alter, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let mut file = File::new();
        alter(&mut file);
        let error = settings_of(&file.write(folder.path()), None, 1).unwrap_err();
        assert!(error.contains(expected) && error.contains("scene.gltf"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    fs::write(&path, "{\"asset\":").unwrap();
    let error = settings_of(&path, None, 1).unwrap_err();
    assert!(error.contains("is not glTF 2.0"), "{error}");
}

#[test]
fn what_was_opened_is_baked_whatever_becomes_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = File::new();
    let path = file.write(folder.path());
    let settings = settings_of(&path, None, 1).unwrap();
    let out = folder.path().join("out");
    bake(gpu(), &settings, &out, &()).unwrap();
    let sequence = Sequence::open(&out, &reader()).unwrap();
    assert_eq!((sequence.name(), sequence.n_frames()), ("square", 1));
    let manifest = fs::read_to_string(out.join("manifest.json")).unwrap();
    let manifest: Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["license"], "CC-BY-4.0 Somebody");
    assert_eq!(
        manifest["bake"]["gltf"]["sha256"],
        settings.gltf.as_ref().unwrap().sha256.as_str()
    );
    file.json["nodes"][0]["translation"] = json!([0, 0, 1]);
    file.write(folder.path());
    let again = folder.path().join("again");
    bake(gpu(), &settings, &again, &()).unwrap();
    let hash = |place: &Path| Sequence::open(place, &reader()).unwrap().hash().unwrap();
    assert_eq!(hash(&again), hash(&out));
    let changed = settings_of(&path, None, 1).unwrap();
    assert_ne!(changed.gltf.as_ref().unwrap().sha256, settings.gltf.unwrap().sha256);
    let other = folder.path().join("other");
    bake(gpu(), &changed, &other, &()).unwrap();
    assert_ne!(hash(&other), hash(&out));
}

#[test]
fn without_a_camera_one_circles_the_scene() {
    let mut file = File::new();
    file.json["scenes"][0]["nodes"] = json!([0]);
    file.json["materials"][0]["doubleSided"] = json!(true);
    let baked = frames(&file, 2);
    let seen = baked[0].object_id.pixels().iter().filter(|id| **id == 1).count();
    assert!(seen > 500, "{seen}");
    assert!(error_of_motion(&baked[1], &baked[0].camera, 0.0) < 2e-3);
    assert!(error_of_motion(&baked[1], &baked[1].camera, 0.0) > 0.1);
}
