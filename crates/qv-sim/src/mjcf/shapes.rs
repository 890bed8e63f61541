//! Geoms: their shapes for contact, and the masses that they give to bodies without an `<inertial>`.
//!
//! <https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-geom>

use super::attributes::{Attributes, Classes, parse};
use super::frames::{Compiler, z_to};
use super::tree::Tree;
use crate::model::inertia::MassProperties;
use crate::urdf::Geometry;
use crate::{MeshReader, MeshShape, SimError};
use glam::{DMat3, DVec3};
use qv_core::Pose;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Density of a geom that states none \[kg/m³\].
const WATER: f64 = 1000.0;

/// A geom, read.
pub(super) struct Geom {
    /// Its own name, else `None`.
    pub name: Option<String>,
    pub line: usize,
    /// In the frame of its body.
    pub pose: Pose,
    /// Whether it touches anything; visuals do not.
    pub collides: bool,
    /// Whether <compiler inertiagrouprange> counts its mass.
    pub weighs: bool,
    /// The shape, or why there is none.
    pub shape: Result<Shape, String>,
    mass: Option<f64>,
    density: f64,
}

/// A shape along z, centred on its own frame but for points \[m\].
pub(super) enum Shape {
    Plane,
    Sphere(f64),
    Capsule { radius: f64, half: f64 },
    Cylinder { radius: f64, half: f64 },
    Ellipsoid(DVec3),
    Box(DVec3),
    Mesh(MeshShape),
}

/// The meshes of <asset>, as vertices.
pub(super) struct Meshes<'a> {
    tree: &'a Tree,
    elements: HashMap<String, Attributes<'a>>,
    folder: String,
    read: Option<&'a MeshReader<'a>>,
}

impl<'a> Meshes<'a> {
    pub fn new(
        tree: &'a Tree,
        classes: &Classes,
        compiler: &Compiler,
        read: Option<&'a MeshReader<'a>>,
    ) -> Result<Self, SimError> {
        let mut elements = HashMap::new();
        for mesh in tree.section("asset").into_iter().filter(|&e| tree.element(e).tag == "mesh") {
            let attributes = Attributes::new(tree, classes, mesh, 0)?;
            // A mesh without a name has its file's, without folders and ending.
            let stem = attributes.text("file").map(|file| {
                let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
                name.rsplit_once('.').map_or(name, |(stem, _)| stem)
            });
            let name = attributes.text("name").or(stem);
            let name = name.ok_or_else(|| attributes.error("an attribute `name` or `file`", "none"))?;
            elements.insert(name.to_owned(), attributes);
        }
        Ok(Self { tree, elements, folder: compiler.mesh_folder.clone(), read })
    }

    /// A mesh in the frame of its geom; the inner error says why it is not there.
    fn mesh(&self, geom: &Attributes) -> Result<Result<MeshShape, String>, SimError> {
        let name = geom.text("mesh").ok_or_else(|| geom.error("an attribute `mesh`", "none"))?;
        let Some(mesh) = self.elements.get(name) else {
            return Err(geom.error("a mesh of <asset>", format!("`{name}`")));
        };
        let MeshShape { vertices, mut triangles } = match (mesh.text("vertex"), mesh.text("file")) {
            (Some(text), _) => {
                let numbers = parse(text).filter(|n| n.len() % 3 == 0);
                let numbers = numbers.ok_or_else(|| mesh.error("triples of finite numbers as `vertex`", "others"))?;
                let faces = mesh.text("face").map(|text| parse(text).filter(|n| n.len() % 3 == 0));
                let triangles = faces.flatten().map_or(Vec::new(), |all| triangles(&all, numbers.len() / 3));
                MeshShape { vertices: numbers.chunks_exact(3).map(DVec3::from_slice).collect(), triangles }
            }
            (None, Some(file)) => {
                let file = format!("{}{file}", self.folder);
                let read = self.read.map(|read| read(&file));
                match read.unwrap_or_else(|| Err(format!("no reader for mesh `{file}`"))) {
                    Ok(shape) => shape,
                    Err(reason) => {
                        return Ok(Err(format!("mesh `{name}` {}: {reason}", self.tree.place(mesh.element()))));
                    }
                }
            }
            (None, None) => {
                return Ok(Err(format!(
                    "mesh `{name}` has neither a file nor vertices {}",
                    self.tree.place(mesh.element())
                )));
            }
        };
        let scale = DVec3::from_array(mesh.vector("scale")?.unwrap_or([1.0; 3]));
        let position = DVec3::from_array(mesh.vector("refpos")?.unwrap_or_default());
        let reference = mesh.vector::<4>("refquat")?.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let Some(reference) = Pose::from_position_wxyz([0.0; 3], reference) else {
            return Err(mesh.error("a `refquat` that is not zero", "zeros"));
        };
        let turn = reference.rotation.conjugate();
        // MuJoCo's `inertia="convex"` asks for the hull, whatever the triangles say; a mirrored mesh is turned inside out.
        if mesh.text("inertia") == Some("convex") {
            triangles.clear();
        }
        if scale.x * scale.y * scale.z < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let vertices = vertices.into_iter().map(|p| scale * (turn * (p - position))).collect();
        Ok(Ok(MeshShape { vertices, triangles }))
    }
}

/// Triangles of a list of indices; none where one is no vertex.
fn triangles(numbers: &[f64], vertices: usize) -> Vec<[u32; 3]> {
    let is_vertex = |x: &f64| x.fract() == 0.0 && (0.0..vertices as f64).contains(x);
    if !numbers.iter().all(is_vertex) {
        return Vec::new();
    }
    numbers.chunks_exact(3).map(|t| [t[0] as u32, t[1] as u32, t[2] as u32]).collect()
}

impl Geom {
    pub fn read(geom: &Attributes, compiler: &Compiler, meshes: &Meshes) -> Result<Self, SimError> {
        let is_on = |name: &str| Ok::<_, SimError>(geom.number_or(name, 1.0)? != 0.0);
        let collides = is_on("contype")? || is_on("conaffinity")?;
        let group = geom.number_or("group", 0.0)?;
        let mass = geom.number("mass")?;
        let density = geom.number_or("density", WATER)?;
        if mass.unwrap_or(density) < 0.0 {
            return Err(geom.error("a mass or density of at least 0", mass.unwrap_or(density)));
        }
        let mut pose = compiler.pose(geom)?;
        let ends = geom.vector::<6>("fromto")?;
        if let Some([x, y, z, u, v, w]) = ends {
            let (from, to) = (DVec3::new(x, y, z), DVec3::new(u, v, w));
            let direction = (from - to).try_normalize();
            let rotation = direction.map(z_to);
            let rotation = rotation.ok_or_else(|| geom.error("two points that differ as `fromto`", "one"))?;
            pose = Pose { position: 0.5 * (from + to), rotation };
        }
        let half = ends.map(|[x, y, z, u, v, w]| 0.5 * (DVec3::new(u, v, w) - DVec3::new(x, y, z)).length());
        let weighs = group >= compiler.groups[0] && group <= compiler.groups[1];
        let has_mass = mass.unwrap_or(density) > 0.0 && weighs;
        // Nobody needs the mesh of a visual that weighs nothing.
        let kind = geom.text("type").unwrap_or("sphere");
        let shape = match kind {
            "mesh" if !collides && !has_mass => Err("a visual".into()),
            "mesh" => meshes.mesh(geom)?.map(Shape::Mesh),
            _ => match geom.text("mesh") {
                Some(mesh) if collides || has_mass => {
                    let place = geom.tree.place(geom.element());
                    Err(format!("a {kind} that MuJoCo fits to mesh `{mesh}`, which is not done here {place}"))
                }
                Some(_) => Err("a visual".into()),
                None => shape(geom, kind, half)?,
            },
        };
        Ok(Self {
            name: geom.tree.attribute(geom.element(), "name").map(str::to_owned),
            line: geom.tree.element(geom.element()).line,
            pose,
            collides,
            weighs,
            shape,
            mass,
            density,
        })
    }

    /// What it weighs, in its body's frame; the error says why that is not known.
    pub fn mass_properties(&self) -> Result<MassProperties, String> {
        if !self.weighs || self.mass.unwrap_or(self.density) == 0.0 {
            return Ok(MassProperties::ZERO);
        }
        let shape = match &self.shape {
            Ok(Shape::Plane) => return Ok(MassProperties::ZERO),
            Ok(shape) => shape,
            Err(reason) => return Err(reason.clone()),
        };
        let (volume, com, unit) = volume_properties(shape)?;
        let mass = self.mass.unwrap_or(self.density * volume);
        Ok(MassProperties { mass, com, inertia: unit * mass }.transformed(&self.pose))
    }
}

/// The primitives. `half` is half the distance of the ends in `fromto`.
fn shape(geom: &Attributes, kind: &str, half: Option<f64>) -> Result<Result<Shape, String>, SimError> {
    let sizes = |needed: usize| {
        let sizes = geom.numbers("size", 1, 3)?.unwrap_or_default();
        let good = sizes.len() >= needed && sizes[..needed].iter().all(|s| *s > 0.0);
        let expected = format!("{needed} positive number{} as `size` of a {kind}", if needed == 1 { "" } else { "s" });
        if good { Ok(sizes) } else { Err(geom.error(expected, format!("{sizes:?}"))) }
    };
    // Of a box or ellipsoid between two points the first number is half the width both ways.
    let three = || match half {
        Some(half) => sizes(1).map(|s| DVec3::new(s[0], s[0], half)),
        None => sizes(3).map(|s| DVec3::new(s[0], s[1], s[2])),
    };
    let two = || match half {
        Some(half) => sizes(1).map(|s| (s[0], half)),
        None => sizes(2).map(|s| (s[0], s[1])),
    };
    Ok(Ok(match kind {
        "plane" => Shape::Plane,
        "sphere" => Shape::Sphere(sizes(1)?[0]),
        "capsule" => two().map(|(radius, half)| Shape::Capsule { radius, half })?,
        "cylinder" => two().map(|(radius, half)| Shape::Cylinder { radius, half })?,
        "ellipsoid" => Shape::Ellipsoid(three()?),
        "box" => Shape::Box(three()?),
        "hfield" | "sdf" => return Ok(Err(format!("a shape `{kind}` {}", geom.tree.place(geom.element())))),
        other => return Err(geom.error("a type of geom", format!("`{other}`"))),
    }))
}

impl Shape {
    /// For contact; `None` for a plane.
    pub fn geometry(&self) -> Option<Geometry> {
        Some(match self {
            Self::Plane => return None,
            Self::Sphere(radius) => Geometry::Sphere(*radius),
            Self::Capsule { radius, half } => Geometry::Capsule { radius: *radius, length: 2.0 * half },
            Self::Cylinder { radius, half } => Geometry::Cylinder { radius: *radius, length: 2.0 * half },
            Self::Ellipsoid(axes) => Geometry::Points(ellipsoid(*axes)),
            Self::Box(half) => Geometry::Box((2.0 * *half).to_array()),
            Self::Mesh(mesh) => Geometry::Points(mesh.vertices.iter().map(|p| p.to_array()).collect()),
        })
    }
}

/// Corners of the hull that stands for an ellipsoid: rings of it, none flatter than [`RINGS`] allows.
fn ellipsoid(axes: DVec3) -> Vec<[f64; 3]> {
    let mut points = vec![[0.0, 0.0, axes.z], [0.0, 0.0, -axes.z]];
    for ring in 1..RINGS {
        let (sine, cosine) = (PI * ring as f64 / RINGS as f64).sin_cos();
        for k in 0..2 * RINGS {
            let (y, x) = (PI * k as f64 / RINGS as f64).sin_cos();
            points.push((axes * DVec3::new(sine * x, sine * y, cosine)).to_array());
        }
    }
    points
}

/// Rings of an ellipsoid's hull from pole to pole: no face lies deeper than 1 - cos(pi / 16) = 2 % of an axis.
pub(super) const RINGS: usize = 8;

/// Volume \[m³\], centre, and inertia about it per kilogram.
fn volume_properties(shape: &Shape) -> Result<(f64, DVec3, DMat3), String> {
    let diagonal = |x: f64, y: f64, z: f64| DMat3::from_diagonal(DVec3::new(x, y, z));
    Ok(match shape {
        Shape::Plane => (0.0, DVec3::ZERO, DMat3::ZERO),
        Shape::Sphere(r) => (4.0 / 3.0 * PI * r.powi(3), DVec3::ZERO, DMat3::IDENTITY * (0.4 * r * r)),
        Shape::Ellipsoid(a) => {
            let s = *a * *a / 5.0;
            (4.0 / 3.0 * PI * a.x * a.y * a.z, DVec3::ZERO, diagonal(s.y + s.z, s.x + s.z, s.x + s.y))
        }
        Shape::Box(a) => {
            let s = *a * *a / 3.0;
            (8.0 * a.x * a.y * a.z, DVec3::ZERO, diagonal(s.y + s.z, s.x + s.z, s.x + s.y))
        }
        Shape::Cylinder { radius: r, half: h } => {
            let across = r * r / 4.0 + h * h / 3.0;
            (2.0 * PI * r * r * h, DVec3::ZERO, diagonal(across, across, 0.5 * r * r))
        }
        Shape::Capsule { radius: r, half: h } => {
            // A cylinder, and a ball cut in two whose halves' centres lie 3/8 r beyond the cylinder's ends.
            let (tube, ball) = (2.0 * PI * r * r * h, 4.0 / 3.0 * PI * r.powi(3));
            let whole = tube + ball;
            let across = tube * (r * r / 4.0 + h * h / 3.0) + ball * (0.4 * r * r + h * h + 0.75 * h * r);
            let along = tube * 0.5 * r * r + ball * 0.4 * r * r;
            (whole, DVec3::ZERO, diagonal(across / whole, across / whole, along / whole))
        }
        Shape::Mesh(mesh) if mesh.is_closed() => properties(&mesh.vertices, &mesh.triangles)?,
        Shape::Mesh(mesh) => hull_properties(&mesh.vertices)?,
    })
}

/// Those of the convex hull.
fn hull_properties(points: &[DVec3]) -> Result<(f64, DVec3, DMat3), String> {
    if points.len() < 4 || points.iter().any(|v| !v.is_finite()) {
        return Err("a mesh without four finite vertices".into());
    }
    let (vertices, triangles) = parry3d_f64::transformation::try_convex_hull(points)
        .map_err(|e| format!("a mesh without a convex hull: {e}"))?;
    properties(&vertices, &triangles)
}

/// Those of a closed surface, as the sum over tetrahedra from one point to each triangle.
fn properties(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(f64, DVec3, DMat3), String> {
    let inside = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for [a, b, c] in triangles.iter().map(|t| t.map(|i| vertices[i as usize] - inside)) {
        let part = a.dot(b.cross(c)) / 6.0;
        let sum = a + b + c;
        volume += part;
        first += part / 4.0 * sum;
        let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        second += (outer(a) + outer(b) + outer(c) + outer(sum)) * (part / 20.0);
    }
    // Triangles may be turned inwards, all of them.
    let turn = volume.signum();
    let (volume, first, second) = (turn * volume, turn * first, second * turn);
    if volume <= 0.0 || !volume.is_finite() {
        return Err("a mesh without a volume".into());
    }
    let (com, second) = (first / volume, second * (1.0 / volume));
    let moment = |m: &DMat3| DMat3::IDENTITY * (m.x_axis.x + m.y_axis.y + m.z_axis.z) - *m;
    let outer = DMat3::from_cols(com * com.x, com * com.y, com * com.z);
    Ok((volume, inside + com, moment(&(second - outer))))
}
