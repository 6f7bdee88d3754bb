//! Priority lists as changes against the list before.
//!
//! A moving eye keeps most of a list: some subobjects enter or leave, and neighbours change places. So a new list
//! travels as a script over the old one: *copy* a run from some place in it, or *insert* ids that are not there. Runs
//! and ids are written as variable-length numbers relative to where the last one ended, which makes the common script
//! ("go on where you were") two bytes a run.
//!
//! Script: repeated `v` (LEB128), length = v >> 1. v even: a copy, followed by the zigzag distance of its start from the
//! end of the previous copy. v odd: an insertion, followed by that many zigzag differences to the previous id.

use crate::codec::CodecError;
use crate::ids::SubobjectId;

/// Writes lists as scripts; keeps the look-up table from frame to frame.
#[derive(Debug, Default)]
pub struct ListEncoder {
    /// For each id its place in the old list, plus one; zero: not there. All zero between calls.
    place: Vec<u32>,
}

impl ListEncoder {
    /// Appends to `out` the script that makes `new` of `old`. Neither list may name an id twice.
    pub fn encode(&mut self, old: &[SubobjectId], new: &[SubobjectId], out: &mut Vec<u8>) {
        let largest = old.iter().chain(new).map(|id| id.0).max().map_or(0, |id| id as usize + 1);
        if self.place.len() < largest {
            self.place.resize(largest, 0);
        }
        for (i, id) in old.iter().enumerate() {
            self.place[id.0 as usize] = i as u32 + 1;
        }
        let mut expected = 0i64;
        let mut previous_id = 0i64;
        let mut i = 0;
        while i < new.len() {
            let start = i;
            let at = self.place[new[i].0 as usize];
            if at == 0 {
                while i < new.len() && self.place[new[i].0 as usize] == 0 {
                    i += 1;
                }
                put_varint(out, ((i - start) as u64) << 1 | 1);
                for id in &new[start..i] {
                    put_varint(out, zigzag(i64::from(id.0) - previous_id));
                    previous_id = i64::from(id.0);
                }
            } else {
                let from = at as usize - 1;
                while i < new.len() && old.get(from + (i - start)) == Some(&new[i]) {
                    i += 1;
                }
                put_varint(out, ((i - start) as u64) << 1);
                put_varint(out, zigzag(from as i64 - expected));
                expected = (from + (i - start)) as i64;
            }
        }
        for id in old {
            self.place[id.0 as usize] = 0;
        }
    }
}

/// Applies a script to `old`; the result replaces the content of `new` and has at most `limit` ids, each below `limit`.
///
/// # Errors
/// [`CodecError`] when the script is malformed or goes beyond the old list or the limit.
pub fn apply(
    old: &[SubobjectId],
    mut script: &[u8],
    limit: usize,
    new: &mut Vec<SubobjectId>,
) -> Result<(), CodecError> {
    new.clear();
    let mut expected = 0i64;
    let mut previous_id = 0i64;
    while !script.is_empty() {
        let v = take_varint(&mut script)?;
        let len = v >> 1;
        let total = (new.len() as u64).saturating_add(len);
        if total > limit as u64 {
            return Err(CodecError::Limit { what: "list length", value: total, limit: limit as u64 });
        }
        if v & 1 == 0 {
            let from = expected.wrapping_add(unzigzag(take_varint(&mut script)?));
            let run = usize::try_from(from).ok().and_then(|from| old.get(from..from.checked_add(len as usize)?));
            let Some(run) = run else {
                return Err(CodecError::Limit {
                    what: "end of a copied run",
                    value: from as u64,
                    limit: old.len() as u64,
                });
            };
            new.extend_from_slice(run);
            expected = from + len as i64;
        } else {
            for _ in 0..len {
                previous_id = previous_id.wrapping_add(unzigzag(take_varint(&mut script)?));
                let id = u32::try_from(previous_id).ok().filter(|id| (*id as usize) < limit);
                let Some(id) = id else {
                    return Err(CodecError::Limit {
                        what: "subobject id",
                        value: previous_id as u64,
                        limit: limit as u64,
                    });
                };
                new.push(SubobjectId(id));
            }
        }
    }
    Ok(())
}

fn zigzag(v: i64) -> u64 {
    ((v << 1) ^ (v >> 63)) as u64
}

fn unzigzag(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

fn put_varint(out: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        out.push(v as u8 | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

fn take_varint(bytes: &mut &[u8]) -> Result<u64, CodecError> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let Some((byte, rest)) = bytes.split_first() else {
            return Err(CodecError::Truncated { what: "list script", needed: 1, left: 0 });
        };
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(CodecError::Limit { what: "bytes of a number", value: 11, limit: 10 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ids(list: &[u32]) -> Vec<SubobjectId> {
        list.iter().map(|id| SubobjectId(*id)).collect()
    }

    fn script(old: &[SubobjectId], new: &[SubobjectId]) -> Vec<u8> {
        let mut out = Vec::new();
        ListEncoder::default().encode(old, new, &mut out);
        out
    }

    #[test]
    fn an_unchanged_list_costs_a_handful_of_bytes() {
        let list: Vec<_> = (0..100_000).map(SubobjectId).collect();
        assert!(script(&list, &list).len() <= 5, "one copy of everything");
    }

    #[test]
    fn one_newcomer_and_one_swap_cost_a_few_runs() {
        let old: Vec<_> = (0..5000).map(SubobjectId).collect();
        let mut new = old.clone();
        new.swap(100, 101);
        new.insert(2000, SubobjectId(9999));
        assert!(script(&old, &new).len() < 30, "{} bytes", script(&old, &new).len());
    }

    proptest! {
        #[test]
        fn applying_a_script_gives_the_new_list(
            old in Just((0..400u32).collect::<Vec<_>>()).prop_shuffle(),
            new in Just((0..400u32).collect::<Vec<_>>()).prop_shuffle(),
            (a, b) in (0usize..400, 0usize..400),
        ) {
            let (old, new) = (ids(&old[..a]), ids(&new[..b]));
            let mut got = Vec::new();
            apply(&old, &script(&old, &new), 400, &mut got).unwrap();
            prop_assert_eq!(got, new);
        }

        #[test]
        fn garbage_is_refused_or_harmless(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let old = ids(&[1, 2, 3]);
            let mut got = Vec::new();
            if apply(&old, &bytes, 100, &mut got).is_ok() {
                prop_assert!(got.len() <= 100 && got.iter().all(|id| id.0 < 100));
            }
        }
    }
}
