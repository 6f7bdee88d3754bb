//! Whatever is done to a file, opening and using it answers and does not panic, hang or ask for the moon.
//!
//! Most mutants keep their checksums right, or none would get behind them. `CYCLORAMA_MUTANTS` says how many there are of each kind; the
//! default is for every run of the tests, a million takes a quarter of an hour.

use super::*;
use crate::scene::baked::check_all;
use crate::scene::baked::file::{self, Section};
use crate::scene::inspect::inspect;
use crate::select::{Selector, Sight};
use proptest::prelude::*;
use proto::view::{Pose, Samples, Tangents, View};

fn cases() -> ProptestConfig {
    let asked = std::env::var("CYCLORAMA_MUTANTS").ok().and_then(|text| text.parse().ok());
    ProptestConfig::with_cases(asked.unwrap_or(400))
}

/// Opens a file and does with it what a manager does.
fn survive(bytes: &[u8]) -> Result<(), TestCaseError> {
    let Ok(scene) = open(bytes) else { return Ok(()) };
    let _ = inspect(&scene).to_string();
    let _ = check_all(&scene);
    let entities = crate::scene::Entities::new(&scene);
    let view = View {
        offset: Pose::IDENTITY,
        tangents: Tangents::symmetric(90.0, 64, 64),
        width: 64,
        height: 64,
        near: View::NEAR_DEFAULT,
        samples: Samples::One,
    };
    let mut selector = Selector::new();
    selector.select(&scene, &entities, &[], &Sight::whole(Pose::IDENTITY, &[view], None));
    prop_assert!(selector.found()[0].subobjects.iter().all(|id| (id.0 as usize) < scene.table.subobjects.len()));
    for object in &scene.objects {
        prop_assert!(scene.subobjects_of(object).end as usize <= scene.table.subobjects.len());
    }
    Ok(())
}

/// Makes all checksums right: of every table that lies within the file, and of the head.
fn vouch(bytes: &mut [u8]) {
    for (at, section) in Section::all().enumerate() {
        let entry = 64 + 64 * at;
        let word = |k: usize| u64::from_le_bytes(bytes[entry + 8 * k..][..8].try_into().unwrap()) as usize;
        let range = word(1)..word(1).saturating_add(word(2));
        if let Some(content) = bytes.get(range).filter(|_| !section.is_payload()) {
            let checksum = *blake3::hash(content).as_bytes();
            bytes[entry + 32..entry + 64].copy_from_slice(&checksum);
        }
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes[..32]).update(&bytes[64..file::SECTIONS_BEGIN]);
    let checksum = *hasher.finalize().as_bytes();
    bytes[32..64].copy_from_slice(&checksum);
}

/// Numbers that are at an edge of something.
fn edge() -> impl Strategy<Value = u64> {
    let doubles = [0.0, -0.0, 1.0, -1.0, 1e39, 1e300, f64::MIN_POSITIVE, f64::NAN, f64::INFINITY];
    let integers = vec![0, 1, 2, 3, 255, 1 << 16, 1 << 31, u64::from(u32::MAX), 1 << 32, u64::MAX - 1, u64::MAX];
    let all: Vec<u64> = doubles.iter().map(|number| number.to_bits()).chain(integers).collect();
    prop::sample::select(all)
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn changed_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let mut bytes = small_file().to_vec();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        survive(&bytes)?;
    }

    /// Numbers in tables swapped for others: by edges, or by those of other rows.
    #[test]
    fn changed_tables_with_right_checksums_never_panic(
        changes in prop::collection::vec((0usize..17, any::<prop::sample::Index>(), edge(), any::<bool>(), any::<prop::sample::Index>()), 1..5),
    ) {
        let mut bytes = small_file().to_vec();
        for (section, place, value, is_wide, from) in changes {
            let entry = 64 + 64 * section;
            let word = |k: usize| u64::from_le_bytes(bytes[entry + 8 * k..][..8].try_into().unwrap()) as usize;
            let (offset, length, width) = (word(1), word(2), if is_wide { 8 } else { 4 });
            let words = length / width;
            if words == 0 {
                continue;
            }
            let at = offset + width * place.index(words);
            let mut number = value.to_le_bytes();
            if value == 3 {
                let from = offset + width * from.index(words);
                number[..width].copy_from_slice(&bytes[from..from + width]);
            }
            bytes[at..at + width].copy_from_slice(&number[..width]);
        }
        vouch(&mut bytes);
        survive(&bytes)?;
    }

    #[test]
    fn a_changed_head_with_a_right_checksum_never_panics(
        changes in prop::collection::vec((16usize..file::SECTIONS_BEGIN / 4, edge()), 1..4),
    ) {
        let mut bytes = small_file().to_vec();
        for (word, value) in changes {
            bytes[4 * word..4 * word + 4].copy_from_slice(&value.to_le_bytes()[..4]);
        }
        vouch(&mut bytes);
        survive(&bytes)?;
    }

    #[test]
    fn cut_and_doubled_stretches_never_panic(
        from in any::<prop::sample::Index>(), length in 0usize..400, is_doubled in any::<bool>(), vouched in any::<bool>(),
    ) {
        let mut bytes = small_file().to_vec();
        let from = from.index(bytes.len());
        let to = (from + length).min(bytes.len());
        let stretch = bytes[from..to].to_vec();
        bytes.splice(from..to, if is_doubled { [stretch.clone(), stretch].concat() } else { Vec::new() });
        if vouched && bytes.len() > file::SECTIONS_BEGIN {
            vouch(&mut bytes);
        }
        survive(&bytes)?;
    }
}

#[test]
fn the_file_that_mutants_are_made_of_survives_itself() {
    let mut bytes = small_file().to_vec();
    let whole = bytes.clone();
    vouch(&mut bytes);
    assert!(bytes == whole, "vouching for a right file changes nothing");
    survive(&bytes).unwrap();
}
