//! Mistakes of vectors, depths and cameras.

use super::{Baked, Mistake, SIZE, assert_named, declared, mistake};
use afterimage::sequence::Frame;
use glam::DMat4;
use serde_json::{Value, json};

/// Near and far planes that device depths are written with.
const NEAR: f64 = 0.05;
const FAR: f64 = 60.0;

fn motion_mistakes() -> Vec<Mistake> {
    let flat = |factor: f64| json!([factor, factor]);
    let in_pixels = |frame: &Frame, x, y| frame.motion_px.as_ref().unwrap().at(x, y).map(f64::from);
    vec![
        declared(
            "motion.direction",
            json!("previous_to_current"),
            json!("current_to_previous"),
        ),
        declared("motion.y", json!("up"), json!("down")),
        declared("motion.scale", json!([-1, 1]), json!([1, 1])).found("motion.x"),
        declared("motion.scale", flat(2.0), flat(1.0)),
        declared("motion.scale", flat(0.5), flat(1.0)),
        declared("motion.units", json!("ndc"), json!("pixels_render")),
        declared("motion.jittered", json!(true), json!(false)),
        mistake(
            "vectors with the change of jitter",
            &["motion.jittered"],
            [("motion.jittered", json!(true))],
            move |baked, manifest| {
                let path = baked.write(["X", "Y"], |frame, x, y| {
                    let before = &baked.frames[frame.index.saturating_sub(1)];
                    let motion = in_pixels(frame, x, y);
                    std::array::from_fn(|i| motion[i] + frame.jitter_px[i] - before.jitter_px[i])
                });
                (manifest["motion"]["path"], manifest["motion"]["channels"]) = (json!(path), json!(["X", "Y"]));
            },
        ),
        mistake(
            "vectors in shares of the image",
            &["motion.units"],
            [("motion.units", json!("uv"))],
            move |baked, manifest| {
                let path = baked.write(["X", "Y"], |frame, x, y| {
                    let [mx, my] = in_pixels(frame, x, y);
                    [mx / f64::from(SIZE.width), my / f64::from(SIZE.height)]
                });
                (manifest["motion"]["path"], manifest["motion"]["channels"]) = (json!(path), json!(["X", "Y"]));
            },
        ),
    ]
}

#[test]
fn vectors_where_the_camera_walks() {
    assert_named("atrium", motion_mistakes());
}

/// Along x only: whatever turns y shows nothing.
#[test]
fn vectors_where_the_camera_turns() {
    let is_along_x = |mistake: &Mistake| !mistake.finds.contains(&"motion.y");
    assert_named("pan", motion_mistakes().into_iter().filter(is_along_x).collect());
}

#[test]
fn vectors_where_a_ball_passes() {
    let is_along_x = |mistake: &Mistake| !mistake.finds.contains(&"motion.y");
    assert_named("sphere", motion_mistakes().into_iter().filter(is_along_x).collect());
}

fn reversed(z: f64) -> f64 {
    if z >= 1e9 { 0.0 } else { NEAR / z }
}

fn forward(z: f64) -> f64 {
    if z >= 1e9 {
        1.0
    } else {
        (FAR - NEAR * FAR / z) / (FAR - NEAR)
    }
}

/// Device depth as `device` makes it, declared as `reversed`, `near` and `far` say.
fn device_depth(device: fn(f64) -> f64, reversed: bool, near: f64, far: Value) -> impl Fn(&Baked, &mut Value) {
    move |baked, manifest| {
        let path = baked.write_depth(device);
        manifest["depth"] = json!({
            "path": path, "channel": "Z", "kind": "device", "reversed": reversed, "near": near, "far": far,
        });
    }
}

fn depth_mistakes() -> Vec<Mistake> {
    let far = || json!(FAR);
    vec![
        mistake(
            "right, reversed",
            &[],
            [],
            device_depth(reversed, true, NEAR, Value::Null),
        ),
        mistake("right, forward", &[], [], device_depth(forward, false, NEAR, far())),
        mistake(
            "reversed, declared forward",
            &["depth.reversed"],
            [("depth.reversed", json!(true))],
            device_depth(reversed, false, NEAR, Value::Null),
        ),
        mistake(
            "forward, declared reversed",
            &["depth.reversed"],
            [("depth.reversed", json!(false))],
            device_depth(forward, true, NEAR, far()),
        ),
    ]
}

fn plane_mistakes() -> Vec<Mistake> {
    let near = || ("depth.near", json!(NEAR));
    vec![
        mistake(
            "twice the near plane",
            &["depth.near"],
            [near()],
            device_depth(reversed, true, 2.0 * NEAR, Value::Null),
        ),
        mistake(
            "0.7 of it",
            &["depth.near"],
            [near()],
            device_depth(forward, false, 0.7 * NEAR, json!(FAR)),
        ),
        mistake(
            "a far plane where there is none",
            &["depth.far"],
            [("depth.far", json!("inf"))],
            device_depth(reversed, true, NEAR, json!(FAR)),
        ),
        mistake(
            "a tenth of the far plane",
            &["depth.far"],
            [("depth.far", json!(FAR))],
            device_depth(forward, false, NEAR, json!(0.1 * FAR)),
        ),
        declared("depth.kind", json!("device"), json!("linear_view_z")),
        declared("depth.kind", json!("ray_distance"), json!("linear_view_z")),
        declared("depth.scale", json!(100), json!(1)),
    ]
}

#[test]
fn orders_of_depth_where_the_camera_walks() {
    assert_named("atrium", depth_mistakes());
}

#[test]
fn orders_of_depth_where_a_ball_passes() {
    assert_named("sphere", depth_mistakes());
}

#[test]
fn planes_and_kinds_of_depth() {
    assert_named("atrium", plane_mistakes());
}

/// Changes every frame's matrices: rows of world to view and of view to clip, and the jitter.
fn cameras(change: fn(&mut DMat4, &mut DMat4, [f64; 2])) -> impl Fn(&Baked, &mut Value) {
    move |baked, manifest| {
        for frame in &baked.frames {
            let camera = &mut manifest["frames"][frame.index]["camera"];
            let rows = |value: &Value| {
                let rows: [[f64; 4]; 4] = serde_json::from_value(value.clone()).unwrap();
                DMat4::from_cols_array_2d(&rows).transpose()
            };
            let (mut view, mut projection) = (rows(&camera["view"]), rows(&camera["projection"]));
            change(&mut view, &mut projection, frame.jitter_px);
            camera["view"] = json!(view.transpose().to_cols_array_2d());
            camera["projection"] = json!(projection.transpose().to_cols_array_2d());
        }
    }
}

fn camera_mistakes() -> Vec<Mistake> {
    let view = |value: &str| ("frames[].camera.view", json!(value));
    let projection = |value: &str| ("frames[].camera.projection", json!(value));
    let finds: &[&str] = &["camera"];
    vec![
        mistake(
            "view by columns",
            finds,
            [view("its transpose")],
            cameras(|view, _, _| *view = view.transpose()),
        ),
        mistake(
            "projection by columns",
            finds,
            [projection("its transpose")],
            cameras(|_, projection, _| *projection = projection.transpose()),
        ),
        mistake(
            "both by columns",
            finds,
            [view("its transpose"), projection("its transpose")],
            cameras(|view, projection, _| (*view, *projection) = (view.transpose(), projection.transpose())),
        ),
        mistake(
            "view to world",
            finds,
            [view("its inverse")],
            cameras(|view, _, _| *view = view.inverse()),
        ),
        mistake(
            "view to world by columns",
            &["camera", "camera"],
            [view("its transpose"), view("its inverse")],
            cameras(|view, _, _| *view = view.inverse().transpose()),
        ),
        mistake(
            "clip space with y down",
            finds,
            [projection("with its second row negated")],
            cameras(|_, projection, _| {
                *projection = DMat4::from_scale(glam::DVec3::new(1.0, -1.0, 1.0)) * *projection;
            }),
        ),
        mistake(
            "with the jitter",
            finds,
            [projection("without jitter")],
            cameras(|_, projection, [x, y]| {
                let mut moved = DMat4::IDENTITY;
                moved.w_axis.x = -2.0 * x / f64::from(SIZE.width);
                moved.w_axis.y = 2.0 * y / f64::from(SIZE.height);
                *projection = moved * *projection;
            }),
        ),
    ]
}

#[test]
fn cameras_that_walk() {
    assert_named("atrium", camera_mistakes());
}

#[test]
fn cameras_that_turn() {
    assert_named("pan", camera_mistakes());
}

/// Nothing moves: only what the matrices themselves show can be told.
#[test]
fn cameras_that_rest() {
    let shown = ["view by columns", "projection by columns", "both by columns"];
    let mistakes = camera_mistakes()
        .into_iter()
        .filter(|mistake| shown.contains(&mistake.what));
    assert_named("static", mistakes.collect());
}
