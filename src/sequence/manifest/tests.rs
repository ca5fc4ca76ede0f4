//! Manifests that are right, and one wrong thing at a time.

use super::*;
use serde_json::json;

fn minimal() -> Value {
    json!({
        "schema": SCHEMA, "name": "minimal", "fps": 24, "render_size": [64, 48], "output_size": [128, 96],
        "color": {"path": "c/{index:04}.exr", "channels": ["R", "G", "B"], "transfer": "linear"},
        "frames": [{"index": 0}, {"index": 1}],
    })
}

/// `minimal` with every section, camera and jitter.
fn full() -> Value {
    let mut manifest = minimal();
    manifest["depth"] = json!({"path": "d.exr", "channel": "Z", "kind": "device", "near": 0.1, "far": 100.0});
    manifest["motion"] = json!({"path": "m.exr", "channels": ["X", "Y"], "units": "uv",
        "direction": "current_to_previous", "y": "down"});
    manifest["jitter"] = json!({"units": "pixels_render", "meaning": "sample_offset", "y": "down"});
    manifest["reference"] = json!({"path": "r.exr", "channels": ["R", "G", "B"]});
    let identity = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let projection = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]]);
    for index in 0..2 {
        manifest["frames"][index] = json!({"index": index, "file_frame": 7, "jitter": [0.25, -0.5], "exposure": 1.0,
            "camera": {"view": identity, "projection": projection, "near": 0.1, "far": 100.0}});
    }
    manifest
}

/// Sets `pointer` (as `/frames/0/index`) to `value`; its parent must exist.
fn with(mut manifest: Value, pointer: &str, value: Value) -> Value {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match manifest.pointer_mut(parent).unwrap() {
        Value::Object(map) => drop(map.insert(key.to_owned(), value)),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        other => panic!("{other} has no fields"),
    }
    manifest
}

fn error(manifest: Value) -> String {
    Manifest::from_value(manifest).unwrap_err().to_string()
}

#[test]
fn the_minimal_and_the_full_manifest_are_accepted() {
    let manifest = Manifest::from_value(minimal()).unwrap();
    assert_eq!(manifest.images().len(), 1);
    assert_eq!(manifest.warmup_frames, 0);
    let manifest = Manifest::from_value(full()).unwrap();
    assert_eq!(manifest.images().len(), 4);
}

#[test]
fn unknown_names_get_the_nearest_known_one() {
    let color = with(minimal(), "/color/transfr", json!("linear"));
    assert_eq!(error(color), "color.transfr: unknown field; did you mean `transfer`?");
    let top = with(minimal(), "/warmup", json!(8));
    assert_eq!(error(top), "warmup: unknown field; did you mean `warmup_frames`?");
    let frame = with(minimal(), "/frames/1/jiter", json!([0, 0]));
    assert_eq!(error(frame), "frames[1].jiter: unknown field; did you mean `jitter`?");
    let variant = with(full(), "/motion/units", json!("pixels_rendr"));
    assert_eq!(
        error(variant),
        "motion.units: unknown value `pixels_rendr`; did you mean `pixels_render`?"
    );
    let preset = with(minimal(), "/preset", json!("blendr"));
    assert_eq!(error(preset), "preset: unknown value `blendr`; did you mean `blender`?");
    let strange = with(minimal(), "/zzz", json!(0));
    assert!(error(strange).starts_with("zzz: unknown field; known are schema, name"));
}

#[test]
fn each_wrong_value_is_named() {
    let matrix_row = json!([0, 0, 0, 0]);
    for (pointer, value, expected) in [
        (
            "/schema",
            json!("afterimage-sequence/2"),
            "schema: `afterimage-sequence/2` is unknown",
        ),
        ("/name", json!(" "), "name: must be"),
        ("/fps", json!(0), "fps: 0 must be a number above 0"),
        ("/render_size", json!([0, 48]), "render_size: 0×48"),
        ("/output_size", json!([64, 16385]), "output_size: 64×16385"),
        ("/render_size", json!([64]), "render_size: invalid length 1"),
        (
            "/display",
            json!({"exposure": -1, "tonemap": "none"}),
            "display.exposure: -1 must be",
        ),
        (
            "/checkerboard",
            json!({"parity": []}),
            "checkerboard.parity: must be a list",
        ),
        ("/samples", json!({"count": 1}), "samples.count: 1 must be 2 to 16"),
        ("/samples", json!({"count": 4}), "color: is the same for every sample"),
        (
            "/color/path",
            json!("{sample}.exr"),
            "color: holds {sample}, and the manifest has no `samples`",
        ),
        (
            "/layers",
            json!({"count": 2, "alpha": {"path": "a.exr", "channel": "A"}}),
            "color: is the same for every layer",
        ),
        ("/frames", json!([]), "frames: is empty"),
        ("/frames/1/index", json!(2), "frames[1].index: 2 must be 1"),
        (
            "/frames/1/jitter",
            json!([0.0, 0.51]),
            "frames[1].jitter: is (0, 0.51) pixels",
        ),
        ("/frames/0/exposure", json!(0), "frames[0].exposure: 0 must be"),
        ("/frames/0/camera/near", json!(-1), "frames[0].camera.near: -1 must be"),
        (
            "/frames/0/camera/far",
            json!(0.05),
            "frames[0].camera.far: 0.05 must lie beyond",
        ),
        ("/color/path", json!("../c.exr"), "color.path: `../c.exr` leaves"),
        ("/color/channels", json!(["R", "G"]), "color.channels: invalid length 2"),
        ("/color/nits_per_unit", json!(0), "color.nits_per_unit: 0 must be"),
        ("/depth/scale", json!(0), "depth.scale: 0 must be"),
        ("/depth/far", json!(0.1), "depth.far: 0.1 must lie beyond"),
        ("/depth/far", json!("far"), "depth.far: `far` is no far plane"),
        ("/depth/kind", json!("linear_view_z"), ""),
        ("/motion/scale", json!([1, 0]), "motion.scale: 0 must be"),
        ("/motion/y", Value::Null, "motion.y: "),
        ("/reference/spp", json!(0), "reference.spp: 0 must be"),
        (
            "/reference/filter_radius_px",
            json!(0),
            "reference.filter_radius_px: 0 must be",
        ),
    ] {
        let result = Manifest::from_value(with(full(), pointer, value));
        match result {
            Ok(_) => assert_eq!(expected, "", "{pointer} was accepted"),
            Err(error) => assert!(error.to_string().starts_with(expected), "{pointer}: {error}"),
        }
    }
    let singular = with(full(), "/frames/1/camera/projection/3", matrix_row);
    let ray = with(singular, "/depth/kind", json!("ray_distance"));
    assert!(error(ray).starts_with("frames[1].camera: `view` and `projection` must be invertible"));
}

#[test]
fn what_one_convention_needs_must_be_there() {
    let mut without_jitter = full();
    without_jitter["jitter"].take();
    assert!(error(without_jitter).starts_with("frames[0].jitter: the manifest has no `jitter`"));
    let numbered = with(minimal(), "/color/path", json!("{file_frame}.exr"));
    assert_eq!(
        error(numbered),
        "frames[0].file_frame: missing, and color.path is `{file_frame}.exr`"
    );
    let pre_exposed = with(minimal(), "/color/pre_exposed", json!(true));
    assert!(error(pre_exposed).starts_with("frames[0].exposure: missing, and color.pre_exposed is true"));
    let linear = with(full(), "/depth/kind", json!("linear_view_z"));
    let mut derived = with(linear, "/motion/invalid_value", json!(0));
    derived["frames"][1]["camera"].take();
    assert_eq!(
        error(derived.clone()),
        "frames[1].camera: missing, and motion.invalid_value needs it"
    );
    derived["depth"].take();
    assert!(error(derived).starts_with("motion.invalid_value: motion can only be derived"));
    let mut device = full();
    device["frames"][0]["camera"].take();
    Manifest::from_value(device.clone()).expect("depth.near needs no camera");
    device["depth"].as_object_mut().unwrap().remove("near");
    assert!(error(device).starts_with("frames[0].camera.near: missing, and device depth needs it"));
    let reversed = with(
        with(full(), "/depth/kind", json!("linear_view_z")),
        "/depth/reversed",
        json!(true),
    );
    assert!(error(reversed).starts_with("depth.reversed: only device depth"));
}

#[test]
fn every_preset_fills_a_bare_manifest_and_yields_to_what_is_given() {
    for preset in [
        "blender",
        "fsr",
        "xess",
        "streamline",
        "arm-nss",
        "unity",
        "unreal",
        "godot",
    ] {
        let mut bare = full();
        bare["preset"] = json!(preset);
        bare["color"].as_object_mut().unwrap().remove("transfer");
        bare.as_object_mut().unwrap().remove("jitter");
        bare["depth"] = json!({"path": "d.exr", "channel": "Z"});
        bare["motion"] = json!({"path": "m.exr", "channels": ["X", "Y"]});
        let jitter_free = with(bare.clone(), "/frames/0/jitter", json!([0, 0]));
        let mut jitter_free = with(jitter_free, "/frames/1/jitter", json!([0, 0]));
        if preset == "godot" {
            // The one other preset that derives motion; a bare manifest need not have cameras in every frame.
            jitter_free["motion"]["invalid_value"] = Value::Null;
        }
        assert!(Manifest::from_value(jitter_free.clone()).is_ok(), "{preset}");
        let given = with(jitter_free, "/motion/y", json!("up"));
        let given = with(given, "/depth/far", json!(5.0));
        let manifest = Manifest::from_value(given).unwrap();
        assert_eq!(manifest.motion.unwrap().y, YAxis::Up, "{preset}");
        assert_eq!(manifest.depth.unwrap().far, FarPlane::At(5.0), "{preset}");
    }
}

#[test]
fn an_explicit_null_wins_over_the_preset() {
    let unreal = |invalid_value: Option<Value>| {
        let mut manifest = full();
        manifest["preset"] = json!("unreal");
        if let Some(value) = invalid_value {
            manifest["motion"]["invalid_value"] = value;
        }
        Manifest::from_value(manifest).unwrap().motion.unwrap().invalid_value
    };
    assert_eq!(unreal(None), Some(InvalidMotion::X(0.0)));
    assert_eq!(unreal(Some(Value::Null)), None);
    assert_eq!(unreal(Some(json!([0, 0]))), Some(InvalidMotion::Xy([0.0, 0.0])));
}

#[test]
fn a_preset_adds_no_section_with_files() {
    let manifest = Manifest::from_value(with(minimal(), "/preset", json!("fsr"))).unwrap();
    assert!(manifest.depth.is_none() && manifest.motion.is_none());
    assert!(manifest.jitter.is_some());
}

#[test]
fn far_planes_come_from_depth_first_and_may_be_infinite() {
    let far = |depth_far: Option<Value>| {
        let mut manifest = full();
        match depth_far {
            Some(far) => manifest["depth"]["far"] = far,
            None => drop(manifest["depth"].as_object_mut().unwrap().remove("far")),
        }
        let manifest = Manifest::from_value(manifest).unwrap();
        manifest.frames[0].far(manifest.depth.as_ref())
    };
    assert_eq!(far(None), FarPlane::At(100.0));
    assert_eq!(far(Some(json!(7))), FarPlane::At(7.0));
    for infinite in [Value::Null, json!(-1), json!("inf")] {
        assert_eq!(far(Some(infinite)), FarPlane::Infinite);
    }
}

#[test]
fn other_colours_follow_the_encoding_of_the_first() {
    let mut manifest = full();
    manifest["color"]["transfer"] = json!("srgb");
    manifest["color"]["pre_exposed"] = json!(true);
    manifest["albedo"] = json!({"path": "a.exr", "channels": ["R", "G", "B"]});
    manifest["unjittered_color"] = json!({"path": "u.exr", "channels": ["R", "G", "B"], "transfer": "linear"});
    let manifest = Manifest::from_value(manifest).unwrap();
    let reference = manifest.reference.unwrap();
    assert_eq!((reference.transfer, reference.pre_exposed), (Transfer::Srgb, true));
    let unjittered = manifest.unjittered_color.unwrap();
    assert_eq!((unjittered.transfer, unjittered.pre_exposed), (Transfer::Linear, true));
    let albedo = manifest.albedo.unwrap();
    assert_eq!((albedo.transfer, albedo.pre_exposed), (Transfer::Linear, false));
}

#[test]
fn what_is_no_json_or_no_object_is_said() {
    let broken = Manifest::parse("{\"schema\": ").unwrap_err().to_string();
    assert!(
        broken.starts_with("not valid JSON: EOF") && broken.contains("line 1"),
        "{broken}"
    );
    assert!(error(json!([])).contains("a manifest is a JSON object"));
}
