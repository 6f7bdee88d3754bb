//! Where buffers and images are: in the scene file, in a `data:` URI, or in a file beside it.
//!
//! A scene is outside input and may name any address. What it may read is the folder it lies in and what is below: no
//! absolute path, no way up, no network. That also makes a scene a thing that can be copied as a folder.

use super::error::Fault;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Longest part of an address that a message repeats.
const SHOWN: usize = 80;

/// The bytes at `uri`, which belongs to `what` ("buffer 0") of a scene in `folder` (`None`: a scene in memory).
pub(super) fn read(uri: &str, what: &str, folder: Option<&Path>) -> Result<Vec<u8>, Fault> {
    if let Some(data) = uri.strip_prefix("data:") {
        let fault = |reason| Fault::DataUri { what: what.into(), reason };
        let (kind, data) = data.split_once(',').ok_or_else(|| fault("it has no comma"))?;
        return if kind.ends_with(";base64") {
            base64(data.as_bytes()).ok_or_else(|| fault("it is not base64"))
        } else {
            percent_decode(data).ok_or_else(|| fault("a % is not followed by two hexadecimal digits"))
        };
    }
    let relative =
        relative_path(uri).map_err(|reason| Fault::Address { what: what.into(), uri: shorten(uri), reason })?;
    let Some(folder) = folder else {
        let reason = "but a scene in memory has no folder";
        return Err(Fault::Address { what: what.into(), uri: shorten(uri), reason });
    };
    let path = folder.join(relative);
    read_file(&path).map_err(|fault| match fault {
        Fault::NoSuchFile => Fault::MissingFile { what: what.into(), path: path.display().to_string() },
        other => other,
    })
}

/// The whole of an ordinary file. A device could go on for ever, so it is refused.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Fault> {
    let named = || path.display().to_string();
    let explain = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => Fault::NoSuchFile,
        _ => Fault::Unreadable { path: named(), error },
    };
    if !fs::metadata(path).map_err(explain)?.is_file() {
        return Err(Fault::NotAFile { path: named() });
    }
    fs::read(path).map_err(explain)
}

/// The path that a relative URI means, or why it is refused. The way up is refused after decoding, for `%2e%2e` is one.
fn relative_path(uri: &str) -> Result<PathBuf, &'static str> {
    let scheme = uri.split(['/', '?', '#']).next().unwrap_or_default();
    if scheme.contains(':') {
        return Err("and only files beside the scene are read");
    }
    let decoded = percent_decode(uri).ok_or("in which a % is not followed by two hexadecimal digits")?;
    let decoded = String::from_utf8(decoded).map_err(|_| "which is not UTF-8")?;
    if decoded.contains('\0') {
        return Err("which contains a zero byte");
    }
    // A backslash separates folders on some systems; writers that mean a file name with one in it are not known.
    let decoded = decoded.replace('\\', "/");
    if decoded.starts_with('/') || decoded.get(1..2) == Some(":") {
        return Err("an absolute path");
    }
    let mut path = PathBuf::new();
    for part in decoded.split('/') {
        match part {
            "" | "." => {}
            ".." => return Err("which leads out of the scene's folder"),
            part => path.push(part),
        }
    }
    if path.as_os_str().is_empty() {
        return Err("which names no file");
    }
    Ok(path)
}

fn percent_decode(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        out.push(match byte {
            b'%' => {
                let mut digit = || char::from(bytes.next()?).to_digit(16);
                (digit()? * 16 + digit()?) as u8
            }
            byte => byte,
        });
    }
    Some(out)
}

/// RFC 4648, section 4; padding may be absent, white space is skipped.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut held) = (0u32, 0u32);
    let mut ended = false;
    for &byte in text {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                ended = true;
                continue;
            }
            b' ' | b'\t' | b'\r' | b'\n' => continue,
            _ => return None,
        };
        if ended {
            return None;
        }
        bits = bits << 6 | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
            bits &= (1 << held) - 1;
        }
    }
    // Six bits left over are a digit that belongs to no byte.
    (held < 6).then_some(out)
}

fn shorten(uri: &str) -> String {
    if uri.chars().count() <= SHOWN { uri.to_owned() } else { uri.chars().take(SHOWN).chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_rfc_4648() {
        for (coded, plain) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg", "foob"), ("Zm9v\nYmFy", "foobar")]
        {
            assert_eq!(base64(coded.as_bytes()).as_deref(), Some(plain.as_bytes()), "{coded}");
        }
        for wrong in ["Z", "Zg==Zg", "Zm9v!", "Zm9vY"] {
            assert_eq!(base64(wrong.as_bytes()), None, "{wrong}");
        }
    }

    #[test]
    fn only_paths_into_the_scenes_folder_are_taken() {
        for (uri, path) in [
            ("walls.bin", "walls.bin"),
            ("a%20b/c%C3%A9.png", "a b/cé.png"),
            ("./textures//wall.png", "textures/wall.png"),
            ("a\\b.png", "a/b.png"),
            ("strange..name", "strange..name"),
        ] {
            assert_eq!(relative_path(uri), Ok(PathBuf::from(path)), "{uri}");
        }
        for uri in [
            "/etc/passwd",
            "../secret",
            "a/../../secret",
            "%2e%2e/secret",
            "..%2fsecret",
            "..\\secret",
            "http://example.org/a.bin",
            "file:///etc/passwd",
            "C:/windows/a.bin",
            "C%3A/windows/a.bin",
            "%2fetc/passwd",
            "a%zz",
            "a%",
            "a%00b",
            "%ff",
            "",
            "./",
        ] {
            assert!(relative_path(uri).is_err(), "{uri} must be refused");
        }
    }
}
