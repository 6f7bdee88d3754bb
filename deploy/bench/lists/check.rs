//! Is an answer right? Every object is asked by itself, by the same exact test, without a tree; and the lists' order is looked through.

use super::field::{Field, PIECES};
use manager::select::{Frustum, Selection, Sight, Where, World, detail, power};
use proto::scene::Sphere;

/// Whether a view sees an object.
pub(super) fn is_visible(frustum: &Frustum, ball: Sphere, least_elements: Option<f64>, elements: f64) -> bool {
    let is_large = least_elements.is_none_or(|least| {
        let reach = elements / least;
        ball.radius * ball.radius * (reach * reach) >= ball.centre.distance_squared(frustum.apex())
    });
    is_large && frustum.ball(ball) != Where::Outside
}

/// By view: the objects that it sees.
pub(super) fn visible(field: &Field, sight: &Sight<'_>) -> Vec<Vec<u32>> {
    let elements = detail::display_factor(sight.views);
    let frusta: Vec<_> = sight.views.iter().map(|view| Frustum::new(sight.eye, view, sight.visibility_m)).collect();
    let of_view = |frustum: &Frustum| {
        let all = 0..field.blocks().count() as u32;
        all.filter(|&object| is_visible(frustum, field.ball(object), sight.least_elements, elements)).collect()
    };
    frusta.iter().map(of_view).collect()
}

/// Whether the lists hold what is to be seen, each once, and in order; or what is wrong.
pub(super) fn check(field: &Field, sight: &Sight<'_>, found: &[Selection]) -> Result<(), String> {
    let mut times = vec![0u8; field.blocks().count() * PIECES as usize];
    for ((number, view), (objects, found)) in
        sight.views.iter().enumerate().zip(visible(field, sight).iter().zip(found))
    {
        let frustum = Frustum::new(sight.eye, view, sight.visibility_m);
        let said = |what: &str| Err(format!("the answer is wrong: view {number}, {what}; please report this"));
        for list in found.lists() {
            let key = |id: u32| power(frustum.apex(), field.piece_ball(id));
            let is_ordered = |pair: &[proto::ids::SubobjectId]| {
                let [a, b] = [pair[0].0, pair[1].0];
                key(a).total_cmp(&key(b)).then(a.cmp(&b)).is_lt()
            };
            if !list.windows(2).all(is_ordered) {
                return said("a list is out of order");
            }
        }
        found.subobjects.iter().for_each(|id| times[id.0 as usize] += 1);
        for &object in objects {
            let is_inside = frustum.ball(field.ball(object)) == Where::Inside;
            for id in object * PIECES..(object + 1) * PIECES {
                let expected = u8::from(is_inside || frustum.ball(field.piece_ball(id)) != Where::Outside);
                if times[id as usize] != expected {
                    return said(&format!("subobject {id} is in {} lists instead of {expected}", times[id as usize]));
                }
                times[id as usize] = 0;
            }
        }
        if times.iter().any(|&times| times > 0) {
            return said("a list has what the view doesn't see");
        }
    }
    Ok(())
}
