//! Where the robot touches the ground, and itself.
//!
//! On a plane everything is done in lanes. On triangles, and between shapes of the robot, each environment asks for
//! itself: those queries branch too much for lanes.

use super::block::{Block, Contact, GroundLanes, Work, contact_points};
use super::constraint::IMPEDANCE_MAX;
use super::cost::normal_force;
use super::rows::ActsOn;
use super::topology::Topology;
use super::vector::*;
use crate::lanes::{Mask, Real, Scalar};
use crate::model::{Geom, Model, Shape};
use crate::options::SimOptions;
use crate::parameters::UNLIMITED;
use crate::terrain::{SurfaceContact, Terrain, Triangle};
use glam::{DMat3, DQuat, DVec3};
use parry3d_f64::query;
use parry3d_f64::shape::{Ball, Capsule, ConvexPolyhedron, Cuboid, Cylinder, SharedShape, Triangle as ParryTriangle};

/// Shapes of one batch and the contact slots that they may fill.
#[derive(Clone)]
pub(crate) struct Colliders {
    pub terrain: Terrain,
    pub slots: Vec<ActsOn>,
    geoms: Vec<Collider>,
    /// Whether inner edges of the ground are felt.
    inner_edges: bool,
    /// Pairs of shapes of the robot that may touch, with their slot.
    pairs: Vec<(usize, usize, usize)>,
}

#[derive(Clone)]
struct Collider {
    index: usize,
    geom: Geom,
    body: usize,
    rotation: [f64; 9],
    position: [f64; 3],
    first_slot: usize,
    slots: usize,
    /// Shape for general queries; spheres on triangles need none.
    shape: SharedShape,
    reach: f64,
    /// Corners in the shape's frame; those of a cylinder are points of its rims.
    corners: Vec<DVec3>,
}

impl Colliders {
    pub fn new(model: &Model, terrain: &Terrain, body_weight: &[[f64; 2]], options: &SimOptions) -> Self {
        let mut slots = Vec::new();
        let mut geoms = Vec::new();
        for (index, geom) in model.geoms.iter().enumerate() {
            let most = contact_points(&geom.shape, terrain.is_plane(), options.inner_edges);
            let count = if terrain.is_none() { 0 } else { most };
            let first_slot = slots.len();
            let weight = body_weight[geom.link][0];
            slots.extend((0..count).map(|_| ActsOn { geom: index, body: geom.link, other: None, weight }));
            geoms.push(Collider {
                index,
                geom: geom.clone(),
                body: geom.link,
                rotation: geom.link_from_geom.matrix().transpose().to_cols_array(),
                position: geom.link_from_geom.position.to_array(),
                first_slot,
                slots: count,
                shape: parry_shape(&geom.shape),
                reach: reach(&geom.shape),
                corners: corners(&geom.shape),
            });
        }
        let mut pairs = Vec::new();
        if options.self_collision {
            for a in 0..geoms.len() {
                for b in a + 1..geoms.len() {
                    let (la, lb) = (model.geoms[a].link, model.geoms[b].link);
                    let adjacent = la == lb || model.links[la].parent == Some(lb) || model.links[lb].parent == Some(la);
                    if !adjacent {
                        let weight = body_weight[la][0] + body_weight[lb][0];
                        pairs.push((a, b, slots.len()));
                        slots.push(ActsOn { geom: a, body: la, other: Some(lb), weight });
                    }
                }
            }
        }
        Self { terrain: terrain.clone(), slots, geoms, inner_edges: options.inner_edges, pairs }
    }

    /// The body that carries a shape, and the shape's centre relative to the base's origin. Needs the kinematics.
    #[inline(always)]
    pub fn centre<L: Real>(&self, geom: usize, block: &Block<L>, work: &Work<L>) -> (usize, V3<L>) {
        let collider = &self.geoms[geom];
        (collider.body, geom_centre(collider, block, work))
    }
}

/// Fills `work.contacts` and `work.live`. Lanes from `used` on are padding and touch nothing.
#[inline(always)]
pub(crate) fn collide<L: Real>(
    topology: &Topology,
    colliders: &Colliders,
    used: usize,
    block: &Block<L>,
    work: &mut Work<L>,
) {
    let origin = origin(topology, block);
    if block.any_sinking {
        work.of_geom.fill(L::one());
    }
    if colliders.terrain.is_plane() {
        for collider in &colliders.geoms {
            touch_plane(collider, origin, block, work);
        }
    } else if !colliders.terrain.is_none() {
        touch_triangles(colliders, origin, used, block, work);
    }
    if !colliders.pairs.is_empty() {
        touch_self(colliders, used, block, work);
    }
    work.live.clear();
    for (index, contact) in work.contacts.iter().enumerate() {
        if contact.active.any() {
            work.live.push(index);
        }
    }
}

/// World position of the point that the work space's coordinates are relative to.
#[inline(always)]
pub(crate) fn origin<L: Real>(topology: &Topology, block: &Block<L>) -> V3<L> {
    if topology.free_base { [block.q[0], block.q[1], block.q[2]] } else { [L::zero(); 3] }
}

/// Ground under shapes that are out of their prints is as it was.
#[inline(always)]
pub(crate) fn leave_prints<L: Real>(block: &mut Block<L>, work: &Work<L>) {
    for (geom, &lowest) in work.of_geom.iter().enumerate() {
        let is_out = L::zero().lt(lowest);
        block.sunk[geom] = L::select(is_out, L::zero(), block.sunk[geom]);
        block.sinking[geom] = L::select(is_out, L::zero(), block.sinking[geom]);
    }
}

/// Shapes that press with more than the ground bears sink in for good. How fast they do follows their force with the time constant of the
/// contact: at once, step by step, the two would chatter.
#[inline(always)]
pub(crate) fn sink<L: Real>(colliders: &Colliders, timestep: f64, block: &mut Block<L>, work: &mut Work<L>) {
    work.of_geom.fill(L::zero());
    for &slot in &work.live {
        let ActsOn { geom, other, .. } = colliders.slots[slot];
        if other.is_none() {
            let force = normal_force(slot, work);
            work.of_geom[geom] += force;
        }
    }
    let step = L::splat(timestep);
    // Of the contact's time constant, from its damping.
    let rate = step * block.ground.damping * L::splat(0.5 * IMPEDANCE_MAX);
    let share = rate / (L::one() + rate);
    for (geom, collider) in colliders.geoms.iter().enumerate() {
        // A mesh has no inside: on triangles no shape sinks deeper than it reaches.
        let most = L::splat(if colliders.terrain.is_plane() { UNLIMITED } else { collider.reach });
        let beyond = (work.of_geom[geom] - block.ground.yield_force).max(L::zero());
        let before = block.sinking[geom];
        let speed = before + share * (block.ground.sink_rate * beyond - before);
        let sunk = block.sunk[geom] + step * speed;
        block.sinking[geom] = L::select(sunk.lt(most), speed, L::zero());
        block.sunk[geom] = sunk.min(most);
    }
}

#[inline(always)]
fn geom_pose<L: Real>(collider: &Collider, block: &Block<L>, work: &Work<L>) -> (M3<L>, V3<L>) {
    let rotation = multiply(&work.rotation[collider.body], &splat9(&collider.rotation));
    (rotation, geom_centre(collider, block, work))
}

#[inline(always)]
fn geom_centre<L: Real>(collider: &Collider, block: &Block<L>, work: &Work<L>) -> V3<L> {
    let from_joint = scale(splat3(collider.position), block.length[collider.body]);
    add(work.position[collider.body], rotate(&work.rotation[collider.body], from_joint))
}

#[inline(always)]
fn touch_plane<L: Real>(collider: &Collider, origin: V3<L>, block: &Block<L>, work: &mut Work<L>) {
    let skin = block.geoms[collider.index].radius_offset;
    let slot = collider.first_slot;
    if collider.slots > 1 {
        let centre = geom_centre(collider, block, work);
        let world = add(origin, centre);
        let height = dot(ground_normal(block), [world[0], world[1], world[2] - block.ground.height]);
        let clear = L::splat(collider.reach)
            + skin
            + rounding([world[0], world[1], world[2].abs() + block.ground.height.abs()]);
        if clear.lt(height).all() {
            clear_slots(collider, work);
            return;
        }
    }
    match &collider.geom.shape {
        Shape::Sphere(radius) => {
            let centre = geom_centre(collider, block, work);
            point(collider, slot, centre, L::splat(*radius) + skin, origin, block, work);
        }
        Shape::Capsule { radius, half_length } => {
            let (rotation, centre) = geom_pose(collider, block, work);
            let along = scale([rotation[2], rotation[5], rotation[8]], L::splat(*half_length));
            for (k, end) in [add(centre, along), sub(centre, along)].into_iter().enumerate() {
                point(collider, slot + k, end, L::splat(*radius) + skin, origin, block, work);
            }
        }
        Shape::Box(half) => {
            let (rotation, centre) = geom_pose(collider, block, work);
            for corner in 0..8 {
                let sign = |bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
                let local = [sign(0) * half.x, sign(1) * half.y, sign(2) * half.z];
                let vertex = add(centre, rotate(&rotation, splat3(local)));
                point(collider, slot + corner, vertex, skin, origin, block, work);
            }
        }
        Shape::Cylinder { radius, half_length } => {
            let (rotation, centre) = geom_pose(collider, block, work);
            let axis = [rotation[2], rotation[5], rotation[8]];
            let (down, side) = rim_directions(axis, ground_normal(block), [rotation[0], rotation[3], rotation[6]]);
            for corner in 0..8 {
                let end = if corner & 4 == 0 { -half_length } else { *half_length };
                let direction = if corner & 2 == 0 { down } else { side };
                let reach = L::splat(if corner & 1 == 0 { *radius } else { -radius });
                let rim = add(add(centre, scale(axis, L::splat(end))), scale(direction, reach));
                point(collider, slot + corner, rim, skin, origin, block, work);
            }
        }
        Shape::Hull(points) => {
            let (rotation, centre) = geom_pose(collider, block, work);
            let vertices = deepest_points(points, &rotation, ground_normal(block), collider.slots);
            for (k, &vertex) in vertices.iter().enumerate() {
                point(collider, slot + k, add(centre, rotate(&rotation, vertex)), skin, origin, block, work);
            }
        }
    }
}

#[inline(always)]
fn ground_normal<L: Real>(block: &Block<L>) -> V3<L> {
    let tilt = &block.ground.tilt;
    [tilt[2], tilt[5], tilt[8]]
}

#[inline(always)]
fn clear_slots<L: Real>(collider: &Collider, work: &mut Work<L>) {
    for slot in collider.first_slot..collider.first_slot + collider.slots {
        work.contacts[slot].active = L::Mask::splat(false);
    }
}

/// More than a few roundings of numbers of this size can add up to: shapes nearer to touching than this are asked in full.
#[inline(always)]
fn rounding<L: Real>(position: V3<L>) -> L {
    let size = position[0].abs() + position[1].abs() + position[2].abs() + L::one();
    size * L::splat(64.0 / (2.0 / 3.0 * <L::Scalar as Scalar>::ROUNDER))
}

/// Contact of a point with a radius and the plane.
#[inline(always)]
fn point<L: Real>(
    collider: &Collider,
    slot: usize,
    centre: V3<L>,
    radius: L,
    origin: V3<L>,
    block: &Block<L>,
    work: &mut Work<L>,
) {
    let normal = ground_normal(block);
    let world = add(origin, centre);
    let height = dot(normal, [world[0], world[1], world[2] - block.ground.height]);
    let mut distance = height - radius;
    if block.any_sinking {
        let lowest = &mut work.of_geom[collider.index];
        *lowest = lowest.min(distance);
        distance += block.sunk[collider.index];
    }
    let active = distance.lt(L::zero());
    work.contacts[slot].active = active;
    if !active.any() {
        return;
    }
    // Between the shape and the bottom of its print.
    let middle = radius + distance * L::splat(0.5);
    let friction = plane_friction(&block.ground, world) * block.geoms[collider.index].friction_scale;
    work.contacts[slot] = Contact { active, normal, point: sub(centre, scale(normal, middle)), distance, friction };
}

/// Directions in a cylinder's caps: steepest downhill (or `any` when it stands upright), and across.
#[inline(always)]
fn rim_directions<L: Real>(axis: V3<L>, normal: V3<L>, any: V3<L>) -> (V3<L>, V3<L>) {
    let along = dot(axis, normal);
    let down = sub(scale(axis, along), normal);
    let squared = dot(down, down);
    let upright = squared.lt(L::splat(1e-8));
    let inverse = L::one() / squared.max(L::splat(1e-8)).sqrt();
    let mut unit = any;
    for k in 0..3 {
        unit[k] = L::select(upright, any[k], down[k] * inverse);
    }
    (unit, cross(axis, unit))
}

/// The `most` vertices that lie deepest, in the shape's frame, each environment by itself.
fn deepest_points<L: Real>(points: &[DVec3], rotation: &M3<L>, normal: V3<L>, most: usize) -> Vec<V3<L>> {
    let mut chosen = vec![[L::zero(); 3]; most];
    for lane in 0..L::LANES {
        let n = lane9(rotation, lane).transpose() * lane3(&normal, lane);
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a].dot(n).total_cmp(&points[b].dot(n)).then(a.cmp(&b)));
        for (k, target) in chosen.iter_mut().enumerate() {
            // A hull has at least four vertices; where it has fewer than slots, the highest stands in for the rest.
            let vertex = points[order[k.min(order.len() - 1)]].to_array();
            (0..3).for_each(|i| target[i].set_lane(lane, L::Scalar::from_f64(vertex[i])));
        }
    }
    chosen
}

#[inline(always)]
fn plane_friction<L: Real>(ground: &GroundLanes<L>, world: V3<L>) -> L {
    let p = rotate_back(&ground.tilt, [world[0], world[1], world[2] - ground.height]);
    patched(ground, p[0], p[1], ground.friction)
}

#[inline(always)]
fn patched<L: Real>(ground: &GroundLanes<L>, x: L, y: L, otherwise: L) -> L {
    let [x0, x1, y0, y1] = ground.patch;
    let inside = x0.le(x) & x.lt(x1) & y0.le(y) & y.lt(y1);
    L::select(inside, ground.patch_friction, otherwise)
}

#[inline(always)]
fn lane3<L: Real>(v: &V3<L>, lane: usize) -> DVec3 {
    DVec3::new(v[0].lane(lane).to_f64(), v[1].lane(lane).to_f64(), v[2].lane(lane).to_f64())
}

/// Row-major lanes to a matrix.
#[inline(always)]
fn lane9<L: Real>(m: &M3<L>, lane: usize) -> DMat3 {
    DMat3::from_cols_array(&m.map(|x| x.lane(lane).to_f64())).transpose()
}

/// The ground's placement in each environment.
struct PlacedTerrain<L: Real> {
    origin: V3<L>,
    /// No environment of the block has tilted ground.
    level: bool,
}

impl<L: Real> PlacedTerrain<L> {
    #[inline(always)]
    fn new(origin: V3<L>, block: &Block<L>) -> Self {
        let mut level = true;
        for (k, &entry) in block.ground.tilt.iter().enumerate() {
            let flat = L::splat(if k % 4 == 0 { 1.0 } else { 0.0 });
            level &= (entry.le(flat) & flat.le(entry)).all();
        }
        Self { origin, level }
    }

    /// A point of the work space in the terrain's coordinates, in lanes: rounded, for comparisons only.
    #[inline(always)]
    fn to_terrain(&self, point: V3<L>, block: &Block<L>) -> V3<L> {
        let world = add(self.origin, point);
        let raised = [world[0], world[1], world[2] - block.ground.height];
        if self.level { raised } else { rotate_back(&block.ground.tilt, raised) }
    }
}

/// The ground's placement in one environment.
struct Lane {
    lane: usize,
    level: bool,
    tilt: DMat3,
    base: DVec3,
    raised: DVec3,
}

impl Lane {
    #[inline(always)]
    fn new<L: Real>(lane: usize, placed: &PlacedTerrain<L>, block: &Block<L>) -> Self {
        let tilt = if placed.level { DMat3::IDENTITY } else { lane9(&block.ground.tilt, lane) };
        let raised = DVec3::new(0.0, 0.0, block.ground.height.lane(lane).to_f64());
        Self { lane, level: placed.level, tilt, base: lane3(&placed.origin, lane), raised }
    }

    #[inline(always)]
    fn turned_back(&self, direction: DVec3) -> DVec3 {
        if self.level { direction } else { self.tilt.transpose() * direction }
    }

    #[inline(always)]
    fn turned(&self, direction: DVec3) -> DVec3 {
        if self.level { direction } else { self.tilt * direction }
    }

    /// A point of the work space in the terrain's coordinates.
    #[inline(always)]
    fn to_terrain<L: Real>(&self, point: &V3<L>) -> DVec3 {
        self.turned_back(lane3(point, self.lane) + self.base - self.raised)
    }
}

#[inline(always)]
fn touch_triangles<L: Real>(colliders: &Colliders, origin: V3<L>, used: usize, block: &Block<L>, work: &mut Work<L>) {
    let placed = PlacedTerrain::new(origin, block);
    for collider in &colliders.geoms {
        clear_slots(collider, work);
        let (rotation, centre) = geom_pose(collider, block, work);
        let skin = block.geoms[collider.index].radius_offset;
        let middle = placed.to_terrain(centre, block);
        // How far a shape reaches down at most. A skin below nothing does not shrink what is searched.
        let reach = match &collider.geom.shape {
            Shape::Capsule { radius, half_length } => {
                let axis = [rotation[2], rotation[5], rotation[8]];
                let down = if placed.level { axis[2] } else { rotate_back(&block.ground.tilt, axis)[2] };
                down.abs() * L::splat(*half_length) + L::splat(*radius)
            }
            _ => L::splat(collider.reach),
        };
        let reach = reach + skin.max(L::zero());
        let bound = L::splat(colliders.terrain.top())
            + reach
            + rounding([middle[0], middle[1], middle[2].abs() + block.ground.height.abs()]);
        let near = !bound.lt(middle[2]);
        if !near.any() {
            continue;
        }
        for lane in 0..used {
            if L::mask_lane(near, lane) {
                let at = Lane::new(lane, &placed, block);
                touch_lane(colliders, collider, &at, &rotation, &centre, block, work);
            }
        }
    }
}

/// Contacts of one shape in one environment.
#[inline(always)]
fn touch_lane<L: Real>(
    colliders: &Colliders,
    collider: &Collider,
    at: &Lane,
    rotation: &M3<L>,
    centre: &V3<L>,
    block: &Block<L>,
    work: &mut Work<L>,
) {
    let lane = at.lane;
    let skin = block.geoms[collider.index].radius_offset.lane(lane).to_f64();
    let middle = at.to_terrain(centre);
    work.found.clear();
    if !middle.is_finite() {
        return;
    }
    let (terrain, inner_edges) = (&colliders.terrain, colliders.inner_edges);
    match &collider.geom.shape {
        Shape::Sphere(radius) => {
            let reach = collider.reach + skin.max(0.0);
            terrain.ball_contacts(middle, radius + skin, reach, &mut work.triangles, &mut work.found);
            SurfaceContact::sort_out(&mut work.found, 0, inner_edges, collider.slots);
        }
        Shape::Capsule { radius, half_length } => {
            // Both ends as spheres; a ridge between them is not felt.
            let axis = at.turned_back(lane3(&[rotation[2], rotation[5], rotation[8]], lane));
            let reach = radius + skin.max(0.0);
            for end in [-half_length, *half_length] {
                let first = work.found.len();
                terrain.ball_contacts(middle + axis * end, radius + skin, reach, &mut work.triangles, &mut work.found);
                SurfaceContact::sort_out(&mut work.found, first, inner_edges, collider.slots / 2);
            }
        }
        _ => {
            let reach = DVec3::splat(collider.reach + skin.max(0.0));
            terrain.triangles_in(middle - reach, middle + reach, &mut work.triangles);
            if !work.triangles.is_empty() {
                let rotation = at.tilt.transpose() * lane9(rotation, lane);
                touch_solid(collider, rotation, middle, skin, &work.triangles, &mut work.found);
            }
        }
    }
    for k in 0..work.found.len().min(collider.slots) {
        write_found(collider, k, at, block, work);
    }
}

/// Writes the k-th contact found.
#[inline(always)]
fn write_found<L: Real>(collider: &Collider, k: usize, at: &Lane, block: &Block<L>, work: &mut Work<L>) {
    let lane = at.lane;
    let found = &work.found[k];
    let mut distance = found.distance;
    let mut middle = found.on_terrain + found.normal * (0.5 * found.distance);
    if block.any_sinking {
        let lowest = &mut work.of_geom[collider.index];
        let sunk = block.sunk[collider.index].lane(lane).to_f64();
        lowest.set_lane(lane, lowest.lane(lane).min(L::Scalar::from_f64(found.distance)));
        distance += sunk;
        middle -= found.normal * (0.5 * sunk);
    }
    let friction = match found.material {
        Some(m) => block.materials[m as usize].lane(lane),
        None => block.ground.friction.lane(lane),
    };
    let [x0, x1, y0, y1] = &block.ground.patch;
    let within = |x: f64, low: &L, high: &L| low.lane(lane).to_f64() <= x && x < high.lane(lane).to_f64();
    let inside = within(middle.x, x0, x1) && within(middle.y, y0, y1);
    let friction = if inside { block.ground.patch_friction.lane(lane) } else { friction };
    let scale = block.geoms[collider.index].friction_scale.lane(lane);
    let point = at.turned(middle) + at.raised - at.base;
    let contact = &mut work.contacts[collider.first_slot + k];
    write(contact, lane, at.turned(found.normal), point, distance, friction * scale);
}

#[inline(always)]
fn write<L: Real>(
    contact: &mut Contact<L>,
    lane: usize,
    normal: DVec3,
    point: DVec3,
    distance: f64,
    friction: L::Scalar,
) {
    // A lane that touches nothing keeps a unit normal, so that no arithmetic on it goes wrong.
    if !contact.active.any() {
        contact.normal = [L::zero(), L::zero(), L::one()];
        contact.point = [L::zero(); 3];
        contact.distance = L::zero();
        contact.friction = L::one();
    }
    for k in 0..3 {
        contact.normal[k].set_lane(lane, L::Scalar::from_f64(normal[k]));
        contact.point[k].set_lane(lane, L::Scalar::from_f64(point[k]));
    }
    contact.distance.set_lane(lane, L::Scalar::from_f64(distance));
    contact.friction.set_lane(lane, friction);
    contact.active = contact.distance.lt(L::zero());
}

/// A shape with a flat side. Its corners against the faces come first, so that it rests on all of them; triangles
/// that no corner touches (a ridge under a face) are asked for their deepest point.
fn touch_solid(
    collider: &Collider,
    rotation: DMat3,
    centre: DVec3,
    skin: f64,
    triangles: &[Triangle],
    found: &mut Vec<SurfaceContact>,
) {
    let mut touched = vec![false; triangles.len()];
    for corner in &collider.corners {
        let point = centre + rotation * *corner;
        let under = triangles.iter().zip(&mut touched).filter_map(|(triangle, touched)| {
            let contact = triangle.point_contact(point, skin, collider.reach)?;
            *touched = true;
            Some(contact)
        });
        found.extend(under.min_by(|a, b| a.distance.total_cmp(&b.distance)));
    }
    let corners = found.len();
    let pose = parry_pose(rotation, centre);
    for (triangle, _) in triangles.iter().zip(&touched).filter(|(_, touched)| !**touched) {
        let [a, b, c] = triangle.corners;
        let shape = ParryTriangle::new(a, b, c);
        let still = parry3d_f64::math::Pose::IDENTITY;
        // An unsupported pair cannot occur: all shapes here are convex.
        if let Ok(Some(contact)) = query::contact(&still, &shape, &pose, &*collider.shape, skin.max(0.0))
            && contact.dist < skin
        {
            let up = (b - a).cross(c - a).normalize();
            let normal = if contact.normal1.dot(up) < 0.0 { up } else { contact.normal1 };
            found.push(SurfaceContact::new(contact.dist - skin, normal, contact.point1, triangle));
        }
    }
    for part in [0..corners, corners..found.len()] {
        found[part].sort_by(|a, b| a.distance.total_cmp(&b.distance));
    }
}

fn touch_self<L: Real>(colliders: &Colliders, used: usize, block: &Block<L>, work: &mut Work<L>) {
    for &(a, b, slot) in &colliders.pairs {
        work.contacts[slot].active = L::Mask::splat(false);
        let (first, second) = (&colliders.geoms[a], &colliders.geoms[b]);
        let (pose_a, pose_b) = (geom_pose(first, block, work), geom_pose(second, block, work));
        for lane in 0..used {
            let (centre_a, centre_b) = (lane3(&pose_a.1, lane), lane3(&pose_b.1, lane));
            if !(centre_a - centre_b).is_finite() || (centre_a - centre_b).length() > first.reach + second.reach {
                continue;
            }
            let place = |pose: &(M3<L>, V3<L>)| parry_pose(lane9(&pose.0, lane), lane3(&pose.1, lane));
            let found = query::contact(&place(&pose_b), &*second.shape, &place(&pose_a), &*first.shape, 0.0);
            if let Ok(Some(contact)) = found
                && contact.dist < 0.0
            {
                let point = (contact.point1 + contact.point2) * 0.5;
                let friction = block.ground.friction.lane(lane);
                write(&mut work.contacts[slot], lane, contact.normal1, point, contact.dist, friction);
            }
        }
    }
}

fn parry_pose(rotation: DMat3, position: DVec3) -> parry3d_f64::math::Pose {
    parry3d_f64::math::Pose::from_parts(position, DQuat::from_mat3(&rotation))
}

fn parry_shape(shape: &Shape) -> SharedShape {
    match shape {
        Shape::Sphere(radius) => SharedShape::new(Ball::new(*radius)),
        Shape::Box(half) => SharedShape::new(Cuboid::new(*half)),
        Shape::Capsule { radius, half_length } => SharedShape::new(Capsule::new_z(*half_length, *radius)),
        Shape::Cylinder { radius, half_length } => {
            // Parry's cylinder stands along y.
            let turn =
                parry3d_f64::math::Pose::from_parts(DVec3::ZERO, DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2));
            SharedShape::compound(vec![(turn, SharedShape::new(Cylinder::new(*half_length, *radius)))])
        }
        Shape::Hull(points) => match ConvexPolyhedron::from_convex_hull(points) {
            Some(hull) => SharedShape::new(hull),
            None => SharedShape::new(Ball::new(0.0)),
        },
    }
}

/// Radius about the shape's origin that holds all of it.
fn reach(shape: &Shape) -> f64 {
    match shape {
        Shape::Sphere(radius) => *radius,
        Shape::Box(half) => half.length(),
        Shape::Capsule { radius, half_length } => radius + half_length,
        Shape::Cylinder { radius, half_length } => radius.hypot(*half_length),
        Shape::Hull(points) => points.iter().map(|p| p.length()).fold(0.0, f64::max),
    }
}

fn corners(shape: &Shape) -> Vec<DVec3> {
    match shape {
        Shape::Sphere(_) | Shape::Capsule { .. } => Vec::new(),
        Shape::Box(half) => {
            let sign = |corner: i32, bit: i32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            (0..8).map(|c| *half * DVec3::new(sign(c, 0), sign(c, 1), sign(c, 2))).collect()
        }
        Shape::Cylinder { radius, half_length } => (0..16)
            .map(|k| {
                let (sin, cos) = (f64::from(k / 2) * std::f64::consts::FRAC_PI_4).sin_cos();
                DVec3::new(radius * cos, radius * sin, if k % 2 == 0 { *half_length } else { -half_length })
            })
            .collect(),
        Shape::Hull(points) => points.clone(),
    }
}
