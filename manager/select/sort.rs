//! Sorts subobjects by power.
//!
//! A key is an f64, of which all bits count (two walls a millimetre apart at a kilometre differ in the thirtieth), and
//! ties go by id, so the order is total and the same everywhere. What is sorted is smaller: an *entry* of 64 bits, the upper half a 32-bit step of the range
//! of powers that a frame has, the lower half the id. Steps are a monotone function of the power, so entries are in order wherever
//! steps differ; where they don't, the powers themselves are asked again. In a scene of a million objects that is a few hundred pairs.
//!
//! One pass of a counting sort over the upper bits of the step brings each entry within a few places of its own, and one pass of
//! insertion, or the library's sort where many share a bucket, does the rest. The number of buckets goes with the length. What makes it quick is where entries
//! come from: blocks are visited nearest first, so at any time reads and writes go to a narrow window of the list, which stays in the cache. A radix sort
//! of three passes moved every entry three times through memory.

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

/// From this length on buckets are used; clearing and summing their counters costs as much as sorting some hundred entries.
const BUCKETS_FROM: usize = 1000;
/// Most bits of a bucket's number: 8 MB of counters, of which a narrow window is in use at a time.
const BUCKET_BITS_MAX: u32 = 21;
/// Buckets of more entries than this are given to the library's sort.
const CROWDED: u32 = 24;

/// Working memory, kept from one sort to the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    spare: Vec<Entry>,
    counts: Vec<u32>,
    ties: Vec<(u64, u32)>,
}

impl Scratch {
    /// Room to sort so many entries.
    pub(super) fn make_room(&mut self, entries: usize) {
        room(&mut self.spare, entries);
        if entries >= BUCKETS_FROM {
            room(&mut self.counts, 2 << bucket_bits(entries));
        }
    }
}

fn bucket_bits(entries: usize) -> u32 {
    // One to two buckets for an entry: most are alone in theirs.
    (entries.ilog2() + 1).min(BUCKET_BITS_MAX)
}

/// Sorts by power, then id; `power` gives the ordered bits of an id's power.
pub(super) fn sort(list: &mut Vec<Entry>, scratch: &mut Scratch, power: impl Fn(u32) -> u64) {
    if list.len() < BUCKETS_FROM {
        list.sort_unstable();
    } else {
        by_buckets(list, scratch);
    }
    settle_ties(list, &mut scratch.ties, power);
}

fn by_buckets(list: &mut Vec<Entry>, Scratch { spare, counts, .. }: &mut Scratch) {
    let (least, most) = list.iter().fold((Entry::MAX, 0), |(least, most), &entry| (least.min(entry), most.max(entry)));
    let (least, range) = (step(least), step(most) - step(least));
    let shift = (32 - range.leading_zeros()).saturating_sub(bucket_bits(list.len()));
    let bucket = |entry: Entry| ((step(entry) - least) >> shift) as usize;
    counts.clear();
    counts.resize((range >> shift) as usize + 1, 0);
    for &entry in &*list {
        counts[bucket(entry)] += 1;
    }
    let (mut start, mut crowd) = (0, 0);
    for count in &mut *counts {
        crowd = crowd.max(*count);
        start += std::mem::replace(count, start);
    }
    spare.resize(list.len(), 0);
    for &entry in &*list {
        let place = &mut counts[bucket(entry)];
        spare[*place as usize] = entry;
        *place += 1;
    }
    std::mem::swap(list, spare);
    if crowd > CROWDED {
        // A bucket's counter is at its end now.
        let mut start = 0;
        for &end in &*counts {
            if end - start > CROWDED {
                list[start as usize..end as usize].sort_unstable();
            }
            start = end;
        }
    }
    for i in 1..list.len() {
        let entry = list[i];
        let mut at = i;
        while at > 0 && list[at - 1] > entry {
            list[at] = list[at - 1];
            at -= 1;
        }
        list[at] = entry;
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
        fn buckets_and_library_agree(
            base in -1e6..1e6f64, spread in prop_oneof![Just(0.0), Just(1e-9), Just(1.0), Just(1e9)],
            seeds in prop::collection::vec(-1.0..1.0f64, 0..BUCKETS_FROM + 3000),
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
            sort(&mut list, &mut Scratch::default(), |id| ordered(powers[id as usize]));
            let found: Vec<u32> = list.into_iter().map(|entry| id(entry).0).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
