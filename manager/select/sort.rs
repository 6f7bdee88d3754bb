//! Sorts subobjects by power.
//!
//! A key is an f64, of which all bits count (two walls a millimetre apart at a kilometre differ in the thirtieth), and
//! ties go by id, so the order is total and the same everywhere. What is sorted is smaller: an *entry* of 64 bits, the upper half a 32-bit step of the range
//! of powers that a frame has, the lower half the id. Steps are a monotone function of the power, so entries are in order wherever
//! steps differ; where they don't, the powers themselves are asked again. In a scene of a million objects that is a few hundred pairs.
//!
//! Two passes of a radix sort over the upper sixteen bits of what the steps differ in, and one pass of insertion for what shares them. Lists are
//! sorted in pieces that a second-level cache holds (`gather.rs`), so that moving entries twice costs less than clearing and summing as many counters
//! as there are entries, which one pass of a counting sort needs. Where insertion would move many, the library's sort does it instead.

use super::walk::room;
use glam::DVec3;
use proto::ids::SubobjectId;
use proto::scene::Sphere;

/// A step, then an id.
pub(super) type Entry = u64;

/// Bits that order as unsigned numbers the way `f64::total_cmp` orders the numbers.
pub(super) fn ordered(key: f64) -> u64 {
    let bits = key.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// The number of such bits.
pub(super) fn unordered(bits: u64) -> f64 {
    f64::from_bits(if bits >> 63 == 1 { bits & !(1 << 63) } else { !bits })
}

/// Between which powers something lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PowerRange {
    pub(super) least: f64,
    pub(super) most: f64,
}

impl Default for PowerRange {
    fn default() -> Self {
        Self::NONE
    }
}

impl PowerRange {
    /// Of nothing.
    pub(super) const NONE: Self = Self { least: f64::INFINITY, most: f64::NEG_INFINITY };

    /// Of all balls within this one.
    pub(super) fn of(ball: Sphere, apex: DVec3) -> Self {
        let (distance, radius) = (ball.centre.distance(apex), ball.radius);
        let least = if distance > radius { (distance - radius).powi(2) } else { -radius * radius };
        Self { least, most: (distance + radius).powi(2) }
    }

    /// Both.
    pub(super) fn and(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.max(other.most) }
    }

    /// With all balls within that one.
    pub(super) fn with(self, ball: Sphere, apex: DVec3) -> Self {
        self.and(Self::of(ball, apex))
    }
}

/// From powers to steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Steps {
    least: f64,
    per_unit: f64,
}

/// The largest step.
const LAST: f64 = u32::MAX as f64;

impl Steps {
    /// Steps over the powers from `least` to `most`.
    pub(super) fn over(least: f64, most: f64) -> Self {
        let range = most - least;
        Self { least, per_unit: if range > 0.0 { LAST / range } else { 0.0 } }
    }

    /// The step of a power; that of the nearer end if it is beyond one. Ascending with the power: each of the operations is.
    #[inline(always)]
    pub(super) fn of(self, power: f64) -> u32 {
        /// Numbers from here on have their unit in the last bit: what is added to it is rounded to whole ones.
        const WHOLE: f64 = (1u64 << 52) as f64;
        let step = (power - self.least) * self.per_unit;
        let step = if step > 0.0 { step } else { 0.0 };
        let step = if step < LAST { step } else { LAST };
        (step + WHOLE).to_bits() as u32
    }
}

/// An entry.
#[inline(always)]
pub(super) fn entry(step: u32, id: u32) -> Entry {
    u64::from(step) << 32 | u64::from(id)
}

/// The step of an entry.
pub(super) fn step(entry: Entry) -> u32 {
    (entry >> 32) as u32
}

/// The id of an entry.
pub(super) fn id(entry: Entry) -> SubobjectId {
    SubobjectId(entry as u32)
}

/// From this length on digits are used; clearing and summing their counters costs as much as sorting some hundred entries.
const DIGITS_FROM: usize = 500;
/// Bits of a digit.
const DIGIT_BITS: u32 = 8;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Insertion may move each entry so many places on the average.
const MOVES: usize = 4;

/// Working memory, kept from one sort to the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    spare: Vec<Entry>,
    ties: Vec<(u64, u32)>,
}

impl Scratch {
    /// Room to sort so many entries.
    pub(super) fn make_room(&mut self, entries: usize) {
        room(&mut self.spare, entries);
    }
}

/// Sorts `list` by power, then id, and puts it behind `out`; `power` gives the ordered bits of an id's power. What `list` holds then is
/// anything.
pub(super) fn append(list: &mut [Entry], scratch: &mut Scratch, power: impl Fn(u32) -> u64, out: &mut Vec<Entry>) {
    let start = out.len();
    if list.len() < DIGITS_FROM {
        list.sort_unstable();
        out.extend_from_slice(list);
    } else {
        out.resize(start + list.len(), 0);
        by_digits(list, &mut scratch.spare, &mut out[start..]);
    }
    settle_ties(&mut out[start..], &mut scratch.ties, power);
}

fn by_digits(list: &[Entry], spare: &mut Vec<Entry>, out: &mut [Entry]) {
    let (least, most) = list.iter().fold((Entry::MAX, 0), |(least, most), &entry| (least.min(entry), most.max(entry)));
    let (least, range) = (step(least), step(most) - step(least));
    let shift = (32 - range.leading_zeros()).saturating_sub(2 * DIGIT_BITS);
    let digits = |entry: Entry| {
        let upper = (step(entry) - least) >> shift;
        [upper as usize % DIGITS, (upper >> DIGIT_BITS) as usize % DIGITS]
    };
    let mut places = [[0u32; DIGITS]; 2];
    for &entry in list {
        let [low, high] = digits(entry);
        places[0][low] += 1;
        places[1][high] += 1;
    }
    for places in &mut places {
        let mut start = 0;
        for place in places {
            start += std::mem::replace(place, start);
        }
    }
    spare.resize(list.len(), 0);
    let [low, high] = &mut places;
    scatter(list, spare, low, |entry| digits(entry)[0]);
    scatter(spare, out, high, |entry| digits(entry)[1]);
    insert(out);
}

/// Puts each entry at its digit's next place.
fn scatter(from: &[Entry], to: &mut [Entry], places: &mut [u32; DIGITS], digit: impl Fn(Entry) -> usize) {
    for &entry in from {
        let place = &mut places[digit(entry)];
        to[*place as usize] = entry;
        *place += 1;
    }
}

/// Sorts what is nearly in order.
fn insert(list: &mut [Entry]) {
    let mut left = MOVES * list.len();
    for i in 1..list.len() {
        let entry = list[i];
        let mut at = i;
        while at > 0 && list[at - 1] > entry {
            list[at] = list[at - 1];
            at -= 1;
        }
        list[at] = entry;
        let moved = i - at;
        if moved > left {
            return list.sort_unstable();
        }
        left -= moved;
    }
}

/// Puts entries of one step in the order of their powers.
fn settle_ties(list: &mut [Entry], ties: &mut Vec<(u64, u32)>, power: impl Fn(u32) -> u64) {
    let mut start = 0;
    while let Some(by) = list[start..].windows(2).position(|pair| step(pair[0]) == step(pair[1])) {
        start += by;
        let shared = step(list[start]);
        let len = list[start..].iter().take_while(|&&entry| step(entry) == shared).count();
        let run = &mut list[start..start + len];
        ties.clear();
        ties.extend(run.iter().map(|&entry| (power(id(entry).0), id(entry).0)));
        ties.sort_unstable();
        for (to, &(_, id)) in run.iter_mut().zip(&*ties) {
            *to = entry(shared, id);
        }
        start += len;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bits_order_like_numbers() {
        let numbers = [f64::NEG_INFINITY, -1e300, -1.0, -1e-300, 0.0, 1e-300, 1.0, 2.0, 1e300, f64::INFINITY];
        assert!(numbers.map(ordered).is_sorted());
        assert_eq!(numbers.map(|number| unordered(ordered(number))), numbers);
    }

    #[test]
    fn steps_ascend_and_end_where_they_should() {
        let steps = Steps::over(-5.0, 1e9);
        let powers = [-1e30, -5.0, -4.0, 0.0, 1.0, 1e3, 5e8, 1e9, 1e300];
        let found = powers.map(|power| steps.of(power));
        assert!(found.is_sorted(), "{found:?}");
        assert_eq!((found[0], found[1], found[7], found[8]), (0, 0, u32::MAX, u32::MAX));
        assert_eq!(Steps::over(3.0, 3.0).of(7.0), 0);
        assert_eq!(Steps::over(f64::INFINITY, f64::NEG_INFINITY).of(7.0), 0, "of nothing");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn digits_and_library_agree(
            base in -1e6..1e6f64, spread in prop_oneof![Just(0.0), Just(1e-9), Just(1.0), Just(1e9)],
            seeds in prop::collection::vec(-1.0..1.0f64, 0..DIGITS_FROM + 3000),
            crowded in any::<bool>(), outlier in prop_oneof![Just(0.0), Just(1e12)],
        ) {
            let mut powers: Vec<f64> = seeds
                .into_iter()
                .map(|k| base + if crowded { (k * 8.0).round() / 8.0 + k * 1e-4 } else { k } * spread)
                .collect();
            powers.push(base + outlier);
            let (least, most) = (-1e6 - 1e9, 1e6 + 1e12);
            let steps = Steps::over(least, most);
            let mut expected: Vec<u32> = (0..powers.len() as u32).collect();
            expected.sort_by(|&a, &b| powers[a as usize].total_cmp(&powers[b as usize]).then(a.cmp(&b)));
            let mut list: Vec<Entry> = (0..).zip(&powers).map(|(id, &power)| entry(steps.of(power), id)).collect();
            let mut sorted = Vec::new();
            append(&mut list, &mut Scratch::default(), |id| ordered(powers[id as usize]), &mut sorted);
            let found: Vec<u32> = sorted.into_iter().map(|entry| id(entry).0).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
