//! Coverage: each face alone, painted white, so that a pixel's linear value times n is the number of points it covers.

use super::*;
use proto::frame::Background;
use reference::screen::Screen;

/// A face that shows white before black, seen from both sides.
fn alone(points: &[DVec3; 3]) -> Content {
    let mut content = Content::default();
    content.add(mesh(points, Material { unlit: true, double_sided: true, ..Material::default() }), DAffine3::IDENTITY);
    content
}

fn black(eye: Pose) -> FrameState {
    let environment = Environment { background: Background::Constant([0.0; 3]), ..Environment::default() };
    FrameState { environment, ..state(eye) }
}

/// Faces from a hundredth of a pixel to far beyond the view, some through the near plane or behind the eye.
fn random_face(random: &mut Random) -> [DVec3; 3] {
    let size = [0.003, 0.05, 0.5, 5.0, 500.0][random.below(5) as usize];
    let centre = DVec3::new(random.between(-2.0, 2.0), random.between(-2.0, 2.0), random.between(-6.0, -0.2));
    std::array::from_fn(|_| (centre + random.vector(size)).as_vec3().as_dvec3())
}

fn random_eye(random: &mut Random) -> Pose {
    let turn = DQuat::from_axis_angle(random.vector(1.0).normalize(), random.between(0.0, 0.2));
    Pose::checked(random.vector(0.1), turn).unwrap()
}

#[test]
fn coverage_is_the_same_for_the_same_vertices_and_points() {
    let mut random = Random(11);
    let mut covered = 0.0;
    for round in 0..600 {
        let samples = ALL_SAMPLES[round % 5];
        let tangents = Tangents { left: -0.9, right: 1.1, bottom: -0.7, top: 1.0 };
        let view = view(40, 34, tangents, samples);
        let (content, state) = (alone(&random_face(&mut random)), black(random_eye(&mut random)));
        let (linear, _) = content.draw(&state, &view);
        let reference = content.reference(&state, &view);
        let n = samples.count() as f64;
        for (i, (drawn, wanted)) in linear.chunks(3).zip(&reference.linear).enumerate() {
            let (drawn, wanted) = (f64::from(drawn[0]) * n, wanted[0] * n);
            assert!((drawn - wanted).abs() < 1e-4, "round {round}, pixel {i}: {drawn} points instead of {wanted}");
            covered += wanted;
        }
    }
    assert!(covered > 1e5, "{covered} points covered in all");
}

#[test]
fn coverage_is_true_where_a_point_is_not_within_a_128th_of_a_pixel_of_an_edge() {
    let mut random = Random(12);
    let (mut compared, mut skipped) = (0, 0);
    for round in 0..400 {
        let view = view(40, 34, Tangents { left: -1.0, right: 1.0, bottom: -0.85, top: 0.85 }, Samples::One);
        let (content, state) = (alone(&random_face(&mut random)), black(random_eye(&mut random)));
        let (linear, _) = content.draw(&state, &view);
        let world = content.world();
        let screen = Screen::new(&world, &state, &view, Vertices::Exact);
        let options = Options { vertices: Vertices::Exact, ..like_pipeline(view.samples) };
        let truth = reference::sample(&world, &state, &view, &options);
        for (i, (drawn, truth)) in linear.chunks(3).zip(&truth.linear).enumerate() {
            let centre = [(i as u32 % view.width) as f64 + 0.5, (i as u32 / view.width) as f64 + 0.5];
            let near = |piece: &reference::screen::Piece| {
                (0..3).any(|k| distance(piece.corners[k], piece.corners[(k + 1) % 3], centre) <= 1.0 / 128.0)
            };
            if screen.pieces.iter().any(near) {
                skipped += 1;
            } else {
                assert_eq!(f64::from(drawn[0]), truth[0], "round {round}, pixel {i}");
                compared += 1;
            }
        }
    }
    println!("{compared} points compared, {skipped} within 1/128 pixel of an edge");
    assert!(skipped * 50 < compared);
}

/// Distance of a point from a line segment.
fn distance(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length = along[0] * along[0] + along[1] * along[1];
    let part = ((to[0] * along[0] + to[1] * along[1]) / length).clamp(0.0, 1.0);
    (to[0] - along[0] * part).hypot(to[1] - along[1] * part)
}

#[test]
fn faces_on_the_grid_with_points_on_their_edges_are_covered_alike() {
    // Every corner is a multiple of 1/64 pixel: edges run through points, and the top-left rule decides.
    let mut random = Random(13);
    let tangents = Tangents { left: -1.0, right: 1.0, bottom: -1.0, top: 1.0 };
    for round in 0..400 {
        let samples = ALL_SAMPLES[round % 5];
        let view = view(16, 16, tangents, samples);
        let depth = [1.0, 2.0, 8.0][random.below(3) as usize];
        let mut corner = || {
            let [x, y] = [0; 2].map(|_| f64::from(random.below(16 * 64)) / 64.0);
            DVec3::new(depth * (x / 8.0 - 1.0), depth * (1.0 - y / 8.0), -depth)
        };
        let content = alone(&[corner(), corner(), corner()]);
        let report = report(&content, &black(Pose::IDENTITY), &view);
        assert_eq!(report.all.max_linear, 0.0, "round {round}: {report}");
    }
}
