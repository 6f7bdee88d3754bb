//! Values of flags: each is read by one function, which says what it would have understood.

use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroUsize};

/// Where the console is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Console {
    Off,
    At(SocketAddr),
}

pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let limit = proto::limits::VIEW_SIZE_MAX;
    match parsed {
        Some((w, h)) if (1..=limit).contains(&w) && (1..=limit).contains(&h) => Ok((w, h)),
        _ => Err(format!("expected WIDTHxHEIGHT in pixels, each 1 to {limit}, as in 1280x720")),
    }
}

pub(super) fn file_kind(text: &str) -> Result<compositor::sinks::FileKind, String> {
    compositor::sinks::FileKind::of_extension(text).ok_or_else(|| "expected png, exr or rgb".into())
}

pub(super) fn simd(text: &str) -> Result<channel::simd::SimdLevel, String> {
    text.parse().map_err(|error: channel::simd::SimdLevelError| error.to_string())
}

pub(super) fn samples(text: &str) -> Result<proto::view::Samples, String> {
    proto::view::Samples::from_name(text).ok_or_else(|| format!("expected {}", proto::view::Samples::NAMES))
}

pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let finite = parts.filter(|parts| parts.iter().all(|p: &f64| p.is_finite()));
    finite.and_then(|parts| parts.try_into().ok()).ok_or_else(|| "expected three numbers, as in 0.5,0.6,0.7".into())
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "expected a number above zero".into())
}

/// Bytes of a number of MiB.
pub(super) fn mebibytes(text: &str) -> Result<u64, String> {
    positive(text).map(|mib| (mib * f64::from(1 << 20)) as u64).map_err(|_| "expected MiB, above zero".into())
}

pub(super) fn resolution(text: &str) -> Result<u32, String> {
    match text {
        "1" | "2" | "4" => text.parse().map_err(|error| format!("{error}")),
        _ => Err("expected 1, 2 or 4".into()),
    }
}

pub(super) fn rate(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| (0.01..=10_000.0).contains(n));
    number.ok_or_else(|| "expected frames a second, 0.01 to 10000".into())
}

pub(super) fn views(text: &str) -> Result<NonZeroU32, String> {
    let most = proto::limits::VIEWS_MAX;
    let number = text.parse().ok().filter(|n: &NonZeroU32| n.get() as usize <= most);
    number.ok_or_else(|| format!("expected 1 to {most}"))
}

pub(super) fn swap_lead(text: &str) -> Result<f64, String> {
    let ms = text.parse().ok().filter(|ms| (0.0..=15.0).contains(ms));
    ms.ok_or_else(|| "expected 0 to 15 ms".into())
}

/// A window's place: nothing, or its upper left corner.
pub(super) fn place(text: &str) -> Result<compositor::window::Place, String> {
    let corner = |text: &str| {
        let (x, y) = text.split_once(',')?;
        Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
    };
    match text {
        "" => Ok(compositor::window::Place { at: None }),
        text => {
            let at = corner(text).ok_or("expected two numbers of pixels with a comma between, like 1920,0")?;
            Ok(compositor::window::Place { at: Some(at) })
        }
    }
}

/// A view by its number.
pub(super) fn shown_view(text: &str) -> Result<u32, String> {
    let most = proto::limits::VIEWS_MAX - 1;
    text.parse().ok().filter(|view: &u32| *view as usize <= most).ok_or_else(|| format!("expected 0 to {most}"))
}

pub(super) fn boards(text: &str) -> Result<NonZeroUsize, String> {
    let most = proto::limits::BOARDS_MAX;
    let number = text.parse().ok().filter(|n: &NonZeroUsize| n.get() <= most);
    number.ok_or_else(|| format!("expected 1 to {most}"))
}

pub(super) fn console(text: &str) -> Result<Console, String> {
    if text == "off" {
        return Ok(Console::Off);
    }
    text.parse().map(Console::At).map_err(|_| "expected an address like 127.0.0.1:7480, or `off`".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_none_are_refused_with_an_example() {
        assert_eq!(size("640x360"), Ok((640, 360)));
        assert!(size("0x5").is_err() && size("640").unwrap_err().contains("1280x720"));
        assert!(triple("1,2").is_err() && triple("nan,0,0").is_err());
        assert_eq!(mebibytes("0.5"), Ok(1 << 19));
        assert!(mebibytes("0").is_err() && mebibytes("lots").unwrap_err().contains("MiB"));
        assert!(positive("-1").is_err() && positive("inf").is_err());
        assert_eq!(console("off"), Ok(Console::Off));
    }
}
