//! The two chunks of a .glb: a header, the JSON, and at most one binary buffer (glTF 2.0, 4.4).

use super::error::Fault;

const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

/// The first bytes of every .glb.
pub(super) const MAGIC: &[u8; 4] = b"glTF";

/// The JSON and, if there is one, the binary chunk of a .glb.
pub(super) fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let word = |at: usize, what: &str| {
        let four = bytes.get(at..at + 4).and_then(|four| <[u8; 4]>::try_from(four).ok());
        four.map(u32::from_le_bytes).ok_or_else(|| damaged(format!("it ends within {what}")))
    };
    let version = word(4, "the header")?;
    if version != 2 {
        return Err(Fault::Version { version: version.to_string() });
    }
    let length = word(8, "the header")? as usize;
    if length > bytes.len() {
        return Err(damaged(format!("cut short, it should have {length} bytes and has {}", bytes.len())));
    }
    let mut at = HEADER;
    let mut json = None;
    // Bytes after the declared length are somebody's padding; chunks of unknown type are to be skipped (4.4.3.3).
    while at < length {
        let size = word(at, "a chunk's header")? as usize;
        let kind = word(at + 4, "a chunk's header")?;
        let body = at + CHUNK_HEADER;
        let chunk = body.checked_add(size).and_then(|end| bytes.get(body..end)).ok_or_else(|| {
            damaged(format!("a chunk of {size} bytes begins at byte {body}, the file has {}", bytes.len()))
        })?;
        match (json, kind) {
            (None, JSON) => json = Some(chunk),
            (None, _) => return Err(damaged("its first chunk is not JSON".into())),
            (Some(json), BIN) => return Ok((json, Some(chunk))),
            (Some(_), _) => {}
        }
        at = body + size;
    }
    json.map(|json| (json, None)).ok_or_else(|| damaged("it has no JSON".into()))
}

fn damaged(what: String) -> Fault {
    Fault::Container { what }
}
