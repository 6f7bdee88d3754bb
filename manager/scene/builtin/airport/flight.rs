//! The flight: twenty seconds of an approach to runway 36, and what moves meanwhile.
//!
//! The eye comes from the south-east, turns onto the centre line in the first half, follows the glide path of 3° to
//! the aiming point and flattens out to a low pass. Everything is a smooth function of time: heading by a polynomial
//! step, height by a soft minimum, bank by the rate of turn that it belongs to, and a breath of turbulence on top.

use super::super::random::smoothstep;
use super::kit::{heading, level, shadow_of, shadow_shift};
use super::runway::{LENGTH, TAXIWAY_X};
use super::terrain::Land;
use crate::host::camera::{CameraEntity, CameraFile, CameraPose};
use glam::{DQuat, DVec3, dvec3};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Frames per second of the path.
pub(super) const RATE: f64 = 60.0;
/// Length of the path, s.
pub(super) const DURATION: f64 = 20.0;
/// Speed over the ground, m/s: 160 kt.
const SPEED: f64 = 82.0;
/// Where the eye is at the end, z, m.
const END_Z: f64 = -420.0;
/// The heading before the turn, clockwise from north, and when the turn begins and ends.
const TURN_FROM: f64 = -0.18;
const TURN: [f64; 2] = [0.0, 10.5];
/// The glide path, rad, and the z where it would meet the ground.
const GLIDE: f64 = 0.0524;
const AIM_Z: f64 = -300.0;
/// Height of the eye in the low pass, m.
const PASS: f64 = 7.0;

/// The nodes that the flight moves; those after the first are shadows of the one before or of their own.
pub(super) mod node {
    pub(crate) const DEPARTING: &str = "departing airliner";
    pub(crate) const DEPARTING_SHADOW: &str = "departing airliner's shadow";
    pub(crate) const TAXIING: &str = "taxiing airliner";
    pub(crate) const TAXIING_SHADOW: &str = "taxiing airliner's shadow";
    pub(crate) const CIRCUIT: &str = "light aircraft in the circuit";
    pub(crate) const CAR: &str = "car on the road";
    pub(crate) const LORRY: &str = "lorry on the road";
    pub(crate) const RADAR: &str = "radar antenna";
}

/// A place and an attitude.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) node: &'static str,
    pub(super) at: DVec3,
    pub(super) turned: DQuat,
}

/// The whole path.
pub(super) fn camera(land: &Land) -> CameraFile {
    let road = land.road_south();
    let track = Track::new();
    let count = (DURATION * RATE) as usize;
    let poses = (0..count)
        .map(|k| {
            let t = k as f64 / RATE;
            let (eye, turned) = track.eye(k);
            CameraPose {
                t: Some(rounded(t, 1e6)),
                eye: eye.to_array().map(|x| rounded(x, 1e4)),
                target: None,
                up: None,
                orientation: Some(turned.to_array().map(|x| rounded(x, 1e7))),
                vertical_fov_deg: Some(45.0),
                tangents: None,
                entities: traffic(t, &road).into_iter().map(entity).collect(),
                versions: BTreeMap::new(),
            }
        })
        .collect();
    CameraFile { origin: None, poses }
}

/// Ten micrometres are enough, and keep a thousand poses readable.
fn rounded(x: f64, parts: f64) -> f64 {
    libm::round(x * parts) / parts
}

fn entity(placed: Placed) -> CameraEntity {
    CameraEntity {
        node: placed.node.into(),
        position: placed.at.to_array().map(|x| rounded(x, 1e4)),
        orientation: placed.turned.to_array().map(|x| rounded(x, 1e7)),
    }
}

/// The eye's way over the ground, integrated backwards from its end so that it ends on the centre line.
#[derive(Debug)]
struct Track {
    places: Vec<(f64, f64)>,
}

impl Track {
    fn new() -> Self {
        let step = SPEED / RATE;
        let mut place = (0.0, END_Z);
        let mut places: Vec<(f64, f64)> = (0..(DURATION * RATE) as usize)
            .rev()
            .map(|k| {
                let here = place;
                let (s, c) = libm::sincos(course((k as f64 - 0.5) / RATE));
                place = (place.0 - s * step, place.1 + c * step);
                here
            })
            .collect();
        places.reverse();
        Self { places }
    }

    fn eye(&self, k: usize) -> (DVec3, DQuat) {
        let t = k as f64 / RATE;
        let (x, z) = self.places[k];
        let breath = |period: f64, phase: f64| libm::sin(TAU * (t / period + phase));
        let fade = smoothstep(20.0, 16.0, t);
        let eye = dvec3(x + 0.25 * fade * breath(4.7, 0.1), path_height(z) + 0.2 * fade * breath(3.1, 0.4), z);

        // A coordinated turn: tan(bank) = v ω / g.
        let rate = (course(t + 0.01) - course(t - 0.01)) / 0.02;
        let bank = libm::atan(SPEED * rate / 9.81) + fade * (0.008 * breath(3.3, 0.0) + 0.005 * breath(1.9, 0.3));
        // The nose follows the path, a little above it, and comes up in the flare.
        let slope = libm::atan((path_height(z - 5.0) - path_height(z + 5.0)) / 10.0);
        let pitch = slope - 0.012 + 0.045 * smoothstep(500.0, -250.0, z) + fade * 0.003 * breath(2.6, 0.7);
        let turned = heading(course(t)) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(-bank);
        (eye, turned)
    }
}

/// The eye's heading, clockwise from north, rad.
fn course(t: f64) -> f64 {
    TURN_FROM * (1.0 - smoothstep(TURN[0], TURN[1], t))
}

/// Height of the glide path, bent into the low pass: a soft maximum of both.
fn path_height(z: f64) -> f64 {
    let sharpness = 4.0;
    let above = (z - AIM_Z) * GLIDE - PASS;
    PASS + sharpness * libm::log1p(libm::exp((above / sharpness).min(500.0)))
}

/// Where everything that moves is at time `t`.
pub(super) fn traffic(t: f64, road: &[DVec3]) -> Vec<Placed> {
    let mut all = Vec::new();
    let mut add = |node, at, turned| all.push(Placed { node, at, turned });

    // The departing airliner rolls when the flight begins, rotates after some 14 s and climbs away.
    let (v0, a) = (34.0, 1.8);
    let z = -430.0 - v0 * t - 0.5 * a * t * t;
    let rotate = smoothstep(13.5, 17.0, t);
    let since = (t - 15.0).max(0.0);
    let climb = 1.15 * since * since * smoothstep(0.0, 2.0, since);
    let at = dvec3(0.0, level::RUNWAY + climb, z);
    add(node::DEPARTING, at, DQuat::from_rotation_x(0.20 * rotate));
    // Its outline is some 3 m above its wheels.
    let shadow = shadow_of(at + DVec3::Y * 3.0);
    add(node::DEPARTING_SHADOW, shadow, DQuat::IDENTITY);

    // Another taxies south on the parallel taxiway towards the holding point.
    let at = dvec3(TAXIWAY_X, level::TAXIWAY, -470.0 + 9.0 * t);
    add(node::TAXIING, at, heading(std::f64::consts::PI));
    let shift = shadow_shift(3.2);
    add(node::TAXIING_SHADOW, dvec3(at.x + shift.x, level::SHADOW, at.z + shift.y), heading(std::f64::consts::PI));

    // A light aircraft turns from crosswind to downwind in the east: 45 m/s on a circle of 520 m.
    let angle = 0.9 + 45.0 / 520.0 * t;
    let (s, c) = libm::sincos(angle);
    let at = dvec3(640.0 - 520.0 * c, 205.0 + 1.2 * t, -1150.0 - 520.0 * s);
    let bank = libm::atan(45.0 * 45.0 / (9.81 * 520.0));
    add(node::CIRCUIT, at, heading(angle) * DQuat::from_rotation_z(-bank));

    let (at, turned) = on_road(road, -640.0 + 19.0 * t, 1.9);
    add(node::CAR, at, turned);
    let (at, turned) = on_road(road, 40.0 - 14.0 * t, -1.9);
    let about = turned * DQuat::from_rotation_y(std::f64::consts::PI);
    add(node::LORRY, at, about);

    // The antenna: a turn in 2.5 s.
    add(node::RADAR, super::buildings::RADAR, heading(TAU * t / 2.5 + FRAC_PI_2));
    all
}

/// The point of the road at this x, `right` metres to the right of its middle for who drives east, and the attitude of
/// a car that drives east there.
fn on_road(road: &[DVec3], x: f64, right: f64) -> (DVec3, DQuat) {
    let k = road.partition_point(|p| p.x < x).clamp(1, road.len() - 1);
    let (a, b) = (road[k - 1], road[k]);
    let t = ((x - a.x) / (b.x - a.x)).clamp(0.0, 1.0);
    // Corners of the road are rounded off by turning gradually from the middle of one stretch to the middle of the
    // next.
    let direction = |k: usize| (road[k] - road[k - 1]).normalize();
    let (other, blend) = if t < 0.5 { (k.max(2) - 1, 0.5 - t) } else { ((k + 1).min(road.len() - 1), t - 0.5) };
    let east = direction(k).lerp(direction(other), blend).normalize();
    let turned = heading(libm::atan2(east.x, -east.z)) * DQuat::from_rotation_x(libm::asin(east.y));
    (a.lerp(b, t) + turned * dvec3(right, 0.05, 0.0), turned)
}

/// The runway's far end must still be ahead when the path ends.
const _: () = assert!(END_Z > -LENGTH, "the path ends beyond the runway");

#[cfg(test)]
mod tests {
    use super::super::super::random::Random;
    use super::super::terrain;
    use super::*;

    fn path() -> CameraFile {
        camera(&Land::new(&mut Random::new(1)))
    }

    #[test]
    fn the_eye_stays_above_the_ground_and_ends_over_the_runway() {
        let file = path();
        assert_eq!(file.poses.len(), 1200);
        for pose in &file.poses {
            let eye = pose.pose().unwrap().position;
            let clear = eye.y - terrain::height(eye.x, eye.z);
            assert!(clear > 5.0, "{clear} m above the ground at {eye}");
        }
        let end = file.poses.last().unwrap().pose().unwrap().position;
        assert!(end.x.abs() < 1.0 && (end.y - PASS).abs() < 0.5 && (end.z - END_Z).abs() < 1.0, "{end}");
    }

    #[test]
    fn the_path_has_no_kink() {
        let poses: Vec<_> = path().poses.iter().map(|p| p.pose().unwrap()).collect();
        for three in poses.windows(3) {
            let bend = three[0].position + three[2].position - 2.0 * three[1].position;
            // 1 g in one sixtieth of a second is 2.7 mm; rounding adds 0.2 mm.
            assert!(bend.length() < 3.0e-3, "acceleration {} g", bend.length() * RATE * RATE / 9.81);
            let turn = |k: usize| three[k].orientation.inverse() * three[k + 1].orientation;
            let jerk = turn(0).angle_between(turn(1));
            assert!(jerk < 3.0e-4, "the rate of turn jumps by {jerk} rad per frame");
        }
    }

    #[test]
    fn traffic_moves_smoothly() {
        let road = Land::new(&mut Random::new(1)).road_south();
        for k in 0..1199 {
            let now = traffic(f64::from(k) / RATE, &road);
            let then = traffic(f64::from(k + 1) / RATE, &road);
            for (a, b) in now.iter().zip(&then) {
                assert_eq!(a.node, b.node);
                assert!(a.at.distance(b.at) < 2.5, "{} jumps at {k}", a.node);
                assert!(a.turned.angle_between(b.turned) < 0.06, "{} spins at {k}", a.node);
            }
        }
    }
}
