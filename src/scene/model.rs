//! What a scene is, before anything is on a device: meshes, materials, objects that move, lights, a camera.
//!
//! Time is counted in frames, as a real number, so that the frame before the first has a place too. World space has y
//! up; a camera looks along −z of its own space.

use super::texture::Mips;
use glam::{DMat3, DMat4, DVec3};

/// A corner of a triangle.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// In the mesh's own space.
    pub position: [f32; 3],
    /// Unit length.
    pub normal: [f32; 3],
    /// Texture coordinates, v down.
    pub uv: [f32; 2],
}

/// Changes vertices with time; their number stays.
pub type Deform = Box<dyn Fn(f64, &[Vertex]) -> Vec<Vertex> + Send + Sync>;

/// Triangles, counter-clockwise seen from the front.
#[derive(Default)]
pub struct Mesh {
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Three a triangle.
    pub indices: Vec<u32>,
    /// Where the vertices themselves move.
    pub deform: Option<Deform>,
}

/// How a material's alpha is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Alpha {
    /// Not at all.
    #[default]
    Opaque,
    /// Holes where it is below one half.
    Cut,
    /// A hole with probability 1 − alpha, drawn for each pixel, frame and sample.
    Stochastic,
    /// Laid over what is behind it, without depth, motion or id of its own; marked in the reactive mask.
    Blended,
}

/// How a texture is looked up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Between texels and between mip levels.
    #[default]
    Trilinear,
    /// The nearest texel of the finest level, whatever the distance: aliases by design.
    Nearest,
}

/// How a surface looks.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear RGB; multiplies the texture.
    pub color: [f32; 3],
    /// Multiplies the texture's alpha.
    pub opacity: f32,
    /// Index into [`Scene::textures`].
    pub texture: Option<usize>,
    /// How the texture is looked up.
    pub filter: Filter,
    /// What alpha does.
    pub alpha: Alpha,
    /// Factor on the colour, given off as light. May be far above 1.
    pub emissive: [f32; 3],
    /// Without it only `emissive` shows.
    pub lit: bool,
    /// Perceptual roughness of the highlight; none where the surface has no highlight.
    pub roughness: Option<f32>,
    /// Reflectance at normal incidence.
    pub specular: f32,
    /// 1 for a metal.
    pub metallic: f32,
    /// Share of the light on the back that shows on the front.
    pub translucency: f32,
    /// Value in the reactive mask.
    pub reactive: f32,
    /// Whether it is seen from behind.
    pub two_sided: bool,
    /// Whether it hides the sun.
    pub casts_shadow: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            color: [0.8; 3],
            opacity: 1.0,
            texture: None,
            filter: Filter::Trilinear,
            alpha: Alpha::Opaque,
            emissive: [0.0; 3],
            lit: true,
            roughness: None,
            specular: 0.04,
            metallic: 0.0,
            translucency: 0.0,
            reactive: 0.0,
            two_sided: false,
            casts_shadow: true,
        }
    }
}

/// Something that depends on time.
pub type At<T> = Box<dyn Fn(f64) -> T + Send + Sync>;

/// Where an object is.
pub enum Placement {
    /// Always there.
    Fixed(DMat4),
    /// World from object, by time.
    Moving(At<DMat4>),
}

impl Placement {
    /// World from object at `time`.
    pub fn at(&self, time: f64) -> DMat4 {
        match self {
            Self::Fixed(matrix) => *matrix,
            Self::Moving(matrix) => matrix(time),
        }
    }
}

/// A mesh somewhere, made of something.
pub struct Object {
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// What the id image holds; objects may share one. 0 is the sky.
    pub id: u32,
    /// Multiplies the material's colour and opacity.
    pub tint: [f32; 4],
    /// Where it is.
    pub placement: Placement,
}

/// A camera's place and opening.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// World to view; view space looks along −z.
    pub view: DMat4,
    /// Vertical opening, radians.
    pub fov_y: f64,
}

impl Pose {
    /// Looks from `eye` at `target`.
    pub fn look(eye: DVec3, target: DVec3, fov_y_degrees: f64) -> Self {
        Self {
            view: looking(eye, target, DVec3::Y),
            fov_y: fov_y_degrees.to_radians(),
        }
    }
}

/// World to a view that looks from `eye` at `target` along −z, with `up` above.
pub fn looking(eye: DVec3, target: DVec3, up: DVec3) -> DMat4 {
    let back = (eye - target).normalize();
    let right = up.cross(back).normalize();
    let above = back.cross(right);
    DMat4::from_mat3(DMat3::from_cols(right, above, back).transpose()) * DMat4::from_translation(-eye)
}

/// A lamp without extent.
#[derive(Clone, Copy, Debug)]
pub struct PointLight {
    /// In the world.
    pub position: DVec3,
    /// Distance at which it has faded to nothing.
    pub range: f64,
    /// Linear RGB: what a white surface close to it shows.
    pub color: [f32; 3],
}

/// Light of one moment.
#[derive(Clone, Debug)]
pub struct Lighting {
    /// Towards the sun; any length.
    pub sun_direction: DVec3,
    /// Linear RGB: what a white surface that faces it shows.
    pub sun_color: [f32; 3],
    /// Straight up.
    pub sky_zenith: [f32; 3],
    /// All around.
    pub sky_horizon: [f32; 3],
    /// Below the horizon.
    pub sky_ground: [f32; 3],
    /// Factor on the light from sky and ground.
    pub ambient: f32,
    /// At most four, and as many at all times.
    pub points: Vec<PointLight>,
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            sun_direction: DVec3::new(0.5, 0.8, 0.4),
            sun_color: [0.95, 0.9, 0.8],
            sky_zenith: [0.18, 0.32, 0.62],
            sky_horizon: [0.65, 0.75, 0.85],
            sky_ground: [0.22, 0.2, 0.18],
            ambient: 0.5,
            points: Vec::new(),
        }
    }
}

/// The ball that the sun's shadows are computed in.
#[derive(Clone, Copy, Debug)]
pub struct ShadowRegion {
    /// Its middle.
    pub center: DVec3,
    /// Its radius.
    pub radius: f64,
    /// Side of the shadow map, texels.
    pub side: u32,
}

/// A camera by time, for one shot: shots differ in it and nothing else.
pub type Camera = Box<dyn Fn(f64, usize) -> Pose + Send + Sync>;

/// Everything that is rendered.
pub struct Scene {
    /// Shapes.
    pub meshes: Vec<Mesh>,
    /// Images, with their smaller levels.
    pub textures: Vec<Mips>,
    /// Looks.
    pub materials: Vec<Material>,
    /// What there is. Objects that follow one another and share mesh and material are drawn together.
    pub objects: Vec<Object>,
    /// Where it is seen from.
    pub camera: Camera,
    /// Frames at which another shot begins.
    pub cuts: Vec<usize>,
    /// Light by time.
    pub lighting: At<Lighting>,
    /// Where the sun throws shadows.
    pub shadows: Option<ShadowRegion>,
    /// Nearest distance that is drawn.
    pub near: f64,
    /// How linear colour is shown: factor before tone mapping.
    pub exposure: f64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            meshes: Vec::new(),
            textures: Vec::new(),
            materials: Vec::new(),
            objects: Vec::new(),
            camera: Box::new(|_, _| Pose::look(DVec3::new(0.0, 1.0, 5.0), DVec3::ZERO, 50.0)),
            cuts: Vec::new(),
            lighting: Box::new(|_| Lighting::default()),
            shadows: None,
            near: 0.05,
            exposure: 1.0,
        }
    }
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene")
            .field("n_meshes", &self.meshes.len())
            .field("n_objects", &self.objects.len())
            .finish_non_exhaustive()
    }
}

impl Scene {
    /// The shot that frame `index` belongs to.
    pub fn shot(&self, index: usize) -> usize {
        self.cuts.iter().filter(|&&cut| cut <= index).count()
    }

    /// Adds a mesh; returns its index.
    pub fn mesh(&mut self, mesh: Mesh) -> usize {
        self.meshes.push(mesh);
        self.meshes.len() - 1
    }

    /// Adds a texture; returns its index.
    pub fn texture(&mut self, mips: Mips) -> usize {
        self.textures.push(mips);
        self.textures.len() - 1
    }

    /// Adds a material; returns its index.
    pub fn material(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Adds an object with an id of its own, untinted.
    pub fn place(&mut self, mesh: usize, material: usize, placement: DMat4) {
        self.add(mesh, material, [1.0; 4], Placement::Fixed(placement));
    }

    /// Adds an object that moves.
    pub fn animate(&mut self, mesh: usize, material: usize, placement: impl Fn(f64) -> DMat4 + Send + Sync + 'static) {
        self.add(mesh, material, [1.0; 4], Placement::Moving(Box::new(placement)));
    }

    /// Adds an object with an id of its own.
    pub fn add(&mut self, mesh: usize, material: usize, tint: [f32; 4], placement: Placement) {
        self.objects.push(Object {
            mesh,
            material,
            id: self.objects.len() as u32 + 1,
            tint,
            placement,
        });
    }
}
