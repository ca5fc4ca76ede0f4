//! What goes wrong with cameras: matrices stored the other way round, or those of another frame.

use crate::sequence::{
    Manifest,
    check::{
        Belief,
        report::{Finding, Report},
    },
    manifest::Camera,
};
use glam::DMat4;
use serde_json::{Value, json};

type Matrix = [[f64; 4]; 4];

/// The camera of a frame without the mistake.
type Mend = Box<dyn Fn(&Manifest, usize) -> Option<Camera> + Sync>;

/// A mistake in the cameras, and what undoes it.
pub struct CameraMistake {
    /// To go after "the cameras'".
    pub says: &'static str,
    pub suggestions: Vec<(&'static str, Value)>,
    mend: Mend,
}

impl CameraMistake {
    /// The cameras without it; none where that makes no cameras of them.
    pub fn mended(&self, manifest: &Manifest) -> Option<Vec<Camera>> {
        (0..manifest.frames.len())
            .map(|index| (self.mend)(manifest, index).filter(is_camera))
            .collect()
    }

    /// The finding, whose message ends in `numbers`.
    pub fn finding(&self, numbers: &str) -> Finding {
        let finding = Finding::warning("camera", format!("the cameras' {}: {numbers}", self.says));
        let suggestions = self.suggestions.iter();
        suggestions.fold(finding, |finding, (field, value)| {
            finding.suggest(*field, value.clone())
        })
    }
}

/// Believes other cameras from now on.
pub fn believe(belief: &mut Belief, cameras: Vec<Camera>) {
    belief.change(|manifest| {
        for (frame, camera) in manifest.frames.iter_mut().zip(cameras) {
            frame.camera = Some(camera);
        }
    });
}

/// Whether the matrices have the last rows of a view and of a perspective projection whose w is the depth.
fn is_camera(camera: &Camera) -> bool {
    let is = |row: [f64; 4], expected: [f64; 4]| row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    let [x, y, z, w] = camera.projection[3];
    is(camera.view[3], [0.0, 0.0, 0.0, 1.0]) && is([x, y, z.abs(), w], [0.0, 0.0, 1.0, 0.0])
}

/// What can be told of the matrices without any image: their last rows.
pub fn shape(belief: &mut Belief, report: &mut Report) {
    let manifest = belief.manifest();
    let cameras: Vec<&Camera> = manifest
        .frames
        .iter()
        .filter_map(|frame| frame.camera.as_ref())
        .collect();
    let n_wrong = cameras.iter().filter(|camera| !is_camera(camera)).count();
    if n_wrong == 0 || cameras.len() < manifest.frames.len() {
        return;
    }
    let numbers = format!(
        "the last row of a view is 0, 0, 0, 1 and that of a perspective projection 0, 0, ±1, 0, which {n_wrong} of {} \
         frames' are not",
        cameras.len()
    );
    let mended = transposed_mistakes()
        .into_iter()
        .find_map(|mistake| Some((mistake.mended(manifest)?, mistake)));
    let finding = match &mended {
        Some((_, mistake)) => mistake.finding(&numbers),
        None => Finding::warning(
            "camera",
            format!("the cameras' matrices are of no kind that is read here: {numbers}"),
        )
        .suggest(
            "frames[].camera",
            json!("rows of world to view, and of view to clip with w the depth"),
        ),
    };
    report.findings.push(finding.with("frames", n_wrong as f64));
    if let Some((cameras, _)) = mended {
        believe(belief, cameras);
    }
}

fn transposed(m: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

/// The same by columns as by rows.
fn inverted(m: Matrix) -> Matrix {
    DMat4::from_cols_array_2d(&m).inverse().to_cols_array_2d()
}

/// A mistake in each frame's own matrices.
fn own(says: &'static str, suggestions: &[(&'static str, &str)], edit: fn(&mut Camera)) -> CameraMistake {
    CameraMistake {
        says,
        suggestions: suggestions
            .iter()
            .map(|(field, value)| (*field, json!(value)))
            .collect(),
        mend: Box::new(move |manifest, index| {
            let mut camera = manifest.frames[index].camera.clone()?;
            edit(&mut camera);
            Some(camera)
        }),
    }
}

const VIEW: &str = "frames[].camera.view";
const PROJECTION: &str = "frames[].camera.projection";

/// Those that matrices show by themselves.
fn transposed_mistakes() -> Vec<CameraMistake> {
    vec![
        own("view is transposed", &[(VIEW, "its transpose")], |camera| {
            camera.view = transposed(camera.view);
        }),
        own("projection is transposed", &[(PROJECTION, "its transpose")], |camera| {
            camera.projection = transposed(camera.projection);
        }),
        own(
            "view and projection are transposed",
            &[(VIEW, "its transpose"), (PROJECTION, "its transpose")],
            |camera| {
                camera.view = transposed(camera.view);
                camera.projection = transposed(camera.projection);
            },
        ),
    ]
}

/// Those that only motion shows.
pub fn mistakes() -> Vec<CameraMistake> {
    let mut all = vec![
        own("view is view to world", &[(VIEW, "its inverse")], |camera| {
            camera.view = inverted(camera.view);
        }),
        own(
            "projection has y flipped",
            &[(PROJECTION, "with its second row negated")],
            |camera| camera.projection[1] = camera.projection[1].map(|value| -value),
        ),
        CameraMistake {
            says: "projection contains the jitter",
            suggestions: vec![(PROJECTION, json!("without jitter"))],
            mend: Box::new(without_jitter),
        },
    ];
    for (lag, says) in [
        (-1, "matrices are those of the frame before"),
        (1, "matrices are those of the frame after"),
    ] {
        all.push(CameraMistake {
            says,
            suggestions: vec![("frames[].camera", json!(format!("of frame index{:+}", -lag)))],
            mend: Box::new(move |manifest, index| {
                // Beyond the ends what is declared stays.
                let other = index
                    .checked_add_signed(-lag)
                    .and_then(|index| manifest.frames.get(index));
                other.unwrap_or(&manifest.frames[index]).camera.clone()
            }),
        });
    }
    all
}

fn without_jitter(manifest: &Manifest, index: usize) -> Option<Camera> {
    let mut camera = manifest.frames[index].camera.clone()?;
    let jitter =
        crate::sequence::convention::jitter_px(manifest.jitter?, manifest.frames[index].jitter, manifest.render_size);
    let size = [manifest.render_size.width, manifest.render_size.height];
    // The image moves against the sample, and clip space has y up.
    for (axis, sign) in [(0, 1.0), (1, -1.0)] {
        let moved = sign * 2.0 * jitter[axis] / f64::from(size[axis]);
        let w = camera.projection[3];
        camera.projection[axis]
            .iter_mut()
            .zip(w)
            .for_each(|(value, w)| *value += moved * w);
    }
    Some(camera)
}
