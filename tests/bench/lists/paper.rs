//! The paper's scene manager (seed 000, section 4), as it stands there but for the key: the plainest correct way, which ours is held against in tests
//! and timed beside in benchmarks. It knows balls and nothing else: no tree, no masks, no buckets.
//!
//! Sections 3 and 4: every object is transformed and tested (the caller's test here, since it is the caller's views that are compared); the visible ones are
//! sorted by depth; *every pair* of them is compared for overlap; an object that overlaps none gives its own list of subobjects, sorted, and a
//! group of such that do one list, merged from those of its objects; lists of neighbours are mixed until there are no more than channels.
//! The key is the power of the eye and not the distance of the centre; see `manager/select`.

/// A ball: centre and radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// World.
    pub centre: [f64; 3],
    /// m.
    pub radius: f64,
}

impl Ball {
    /// |centre − eye|² − radius².
    pub fn power(&self, eye: [f64; 3]) -> f64 {
        self.squared(eye) - self.radius * self.radius
    }

    fn squared(&self, from: [f64; 3]) -> f64 {
        let [x, y, z] = std::array::from_fn(|axis| self.centre[axis] - from[axis]);
        (x * x) + (y * y) + (z * z)
    }

    /// "distance between the object SP`[j]` and the object SP`[i]` less than the sum of the extent radiuses?"
    pub fn overlaps(&self, other: &Self) -> bool {
        self.squared(other.centre) < (self.radius + other.radius) * (self.radius + other.radius)
    }
}

/// An object: its ball and its subobjects.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Encloses its subobjects.
    pub ball: Ball,
    /// Number and ball of each.
    pub subobjects: Vec<(u32, Ball)>,
}

/// What the plain algorithm finds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plain {
    /// SP: indices of the visible objects by ascending power.
    pub objects: Vec<usize>,
    /// Indices of the objects of each group, those of one too; members ascending, groups by their nearest object.
    pub groups: Vec<Vec<usize>>,
    /// QS: by group, subobjects by ascending power.
    pub group_lists: Vec<Vec<u32>>,
    /// Pairs that were compared.
    pub pairs: u64,
}

/// Does steps 2 to 6 of manager.md for one view; `is_visible` says which objects, and which of their subobjects, the view sees.
pub fn plain(
    all: &[Object],
    eye: [f64; 3],
    is_visible: impl Fn(usize) -> bool,
    is_seen: impl Fn(usize, usize) -> bool,
) -> Plain {
    let mut objects: Vec<usize> = (0..all.len()).filter(|&object| is_visible(object)).collect();
    objects.sort_by(|&a, &b| all[a].ball.power(eye).total_cmp(&all[b].ball.power(eye)).then(a.cmp(&b)));
    // Marks: each object's group is the smallest place in SP that it can reach.
    let mut group: Vec<usize> = (0..objects.len()).collect();
    let mut pairs = 0;
    for i in 0..objects.len() {
        for j in i + 1..objects.len() {
            pairs += 1;
            if all[objects[i]].ball.overlaps(&all[objects[j]].ball) && group[i] != group[j] {
                let (from, to) = (group[i].max(group[j]), group[i].min(group[j]));
                group.iter_mut().filter(|group| **group == from).for_each(|group| *group = to);
            }
        }
    }
    let mut found = Plain { objects, groups: Vec::new(), group_lists: Vec::new(), pairs };
    for root in 0..group.len() {
        let places: Vec<usize> = (0..group.len()).filter(|&place| group[place] == root).collect();
        if places.is_empty() {
            continue;
        }
        let mut members: Vec<usize> = places.iter().map(|&place| found.objects[place]).collect();
        members.sort_unstable();
        let sorted = |&object: &usize| {
            let own = all[object].subobjects.iter().enumerate().filter(|(piece, _)| is_seen(object, *piece));
            let mut own: Vec<(f64, u32)> = own.map(|(_, (id, ball))| (ball.power(eye), *id)).collect();
            own.sort_by(before);
            own
        };
        let merged = members.iter().map(sorted).fold(Vec::new(), |a, b| merge(&a, &b));
        found.group_lists.push(merged.into_iter().map(|(_, id)| id).collect());
        found.groups.push(members);
    }
    found
}

fn before(a: &(f64, u32), b: &(f64, u32)) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

/// The paper's merge of two sorted lists, by ascending key.
fn merge(a: &[(f64, u32)], b: &[(f64, u32)]) -> Vec<(f64, u32)> {
    let (mut i, mut j, mut out) = (0, 0, Vec::with_capacity(a.len() + b.len()));
    while i < a.len() || j < b.len() {
        let from_a = j == b.len() || (i < a.len() && before(&a[i], &b[j]).is_le());
        out.push(if from_a { a[i] } else { b[j] });
        if from_a { i += 1 } else { j += 1 }
    }
    out
}

/// The paper's table of operations (section 5), for `objects` objects of which `occluded` overlap, each of `planes` planes of `points` points.
/// The two terms that the table prints as products of nothing (R and L of its subobject sorter) are read as they stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Operations {
    /// C: comparisons with a jump.
    pub comparisons: f64,
    /// L: reads and writes of memory.
    pub memory: f64,
    /// A: additions.
    pub additions: f64,
    /// M: multiplications.
    pub multiplications: f64,
    /// D: divisions.
    pub divisions: f64,
}

impl Operations {
    /// The three units of the paper's device together.
    pub fn of_paper(objects: f64, occluded: f64, planes: f64, points: f64) -> Self {
        let merged = occluded * planes - 1.0;
        Self {
            comparisons: 6.0 * objects + (2.0 * objects - 1.0) + merged * 2.0 * points,
            memory: 241.0
                + 224.0 * objects
                + (90.0 * objects - 20.0)
                + occluded * (202.0 * planes * points + 63.0 * planes - 144.0 * points)
                + objects * (planes * (3.0 + 7.0 * points) + 1.0),
            additions: 4.0 + 8.0 * objects + (7.0 * objects - 7.0) + 27.0 * points * merged,
            multiplications: 16.0 + 9.0 * objects + (4.0 * objects - 4.0) + 48.0 * points * merged,
            divisions: 9.0 * points * merged,
        }
    }

    /// All classes.
    pub fn sum(&self) -> f64 {
        self.comparisons + self.memory + self.additions + self.multiplications + self.divisions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(x: f64, radius: f64) -> Ball {
        Ball { centre: [x, 0.0, 0.0], radius }
    }

    #[test]
    fn two_that_overlap_are_one_group_and_their_lists_are_merged() {
        let object = |x: f64, radius: f64, ids: [u32; 2]| Object {
            ball: ball(x, radius),
            subobjects: vec![(ids[0], ball(x - 0.5, 0.1)), (ids[1], ball(x + 0.5, 0.1))],
        };
        let all = [object(10.0, 1.0, [0, 1]), object(10.75, 1.0, [2, 3]), object(5.0, 1.0, [4, 5])];
        let found = plain(&all, [0.0; 3], |_| true, |_, _| true);
        assert_eq!(found.objects, [2, 0, 1]);
        assert_eq!(found.groups, [vec![2], vec![0, 1]]);
        assert_eq!(found.group_lists, [vec![4, 5], vec![0, 2, 1, 3]]);
        assert_eq!(found.pairs, 3);
    }

    #[test]
    fn the_papers_own_example_is_of_the_papers_order_of_magnitude() {
        // 1000 objects, 60 occluded, 25 Hz at 100 MHz: 4 million cycles a frame.
        let sum = Operations::of_paper(1000.0, 60.0, 10.0, 4.0).sum();
        assert!((1e5..4e6).contains(&sum), "{sum}");
    }
}
