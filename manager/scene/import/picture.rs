//! Images of the file: PNG and JPEG, decoded to 8-bit RGBA, each once, and only those that a drawn material shows.

use super::accessor::{Data, at};
use super::error::Fault;
use super::uri;
use image::{ImageError, ImageFormat, ImageReader, Limits};
use proto::limits;
use proto::scene::Texture;
use std::io::Cursor;
use std::path::Path;

/// Most bytes that decoding one picture may take besides its pixels: a 16-bit RGBA PNG needs twice the size of what
/// we keep.
const DECODER_BYTES_MAX: u64 = 2 * limits::BULK_MESSAGE_MAX as u64;

/// Reads and decodes image `index`.
pub(super) fn load(data: &Data<'_>, index: usize, folder: Option<&Path>, place: &str) -> Result<Texture, Fault> {
    let described = at(&data.root.images, index, "image", place)?;
    let what = match described.name.as_deref().or(described.uri.as_deref().filter(|uri| !uri.starts_with("data:"))) {
        Some(name) if !name.is_empty() => format!("image {index} ({name})"),
        _ => format!("image {index}"),
    };
    match (&described.buffer_view, &described.uri) {
        (Some(view), _) => decode(data.view(view.value(), &what)?, &what),
        (None, Some(address)) => decode(&uri::read(address, &what, folder)?, &what),
        (None, None) => Err(Fault::Picture { what, reason: "has no data; export the scene again".into() }),
    }
}

// The declared MIME type is not looked at: writers get it wrong, and the first bytes don't lie.
fn decode(bytes: &[u8], what: &str) -> Result<Texture, Fault> {
    let fault = |reason: String| Fault::Picture { what: what.into(), reason };
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(other) => return Err(fault(format!("is {other:?}, not PNG or JPEG; convert it"))),
        Err(_) => return Err(fault("is neither PNG nor JPEG; convert it".into())),
    };
    let mut bounds = Limits::no_limits();
    bounds.max_image_width = Some(limits::TEXTURE_SIZE_MAX);
    bounds.max_image_height = Some(limits::TEXTURE_SIZE_MAX);
    bounds.max_alloc = Some(DECODER_BYTES_MAX);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(bounds.clone());
    let too_large = |(width, height): (u32, u32)| {
        let (side, mib) = (limits::TEXTURE_SIZE_MAX, limits::BULK_MESSAGE_MAX >> 20);
        fault(format!(
            "is {width} × {height}, at most {side} a side and {mib} MiB of pixels are possible; make it smaller"
        ))
    };
    let explain = |error: ImageError| match error {
        ImageError::Limits(_) => fault("is too large to decode; make it smaller".into()),
        // Decoders' messages may have several lines.
        other => fault(format!("cannot be decoded ({}); save it again", other.to_string().replace('\n', " "))),
    };
    let size = ImageReader::with_format(Cursor::new(bytes), format).into_dimensions().map_err(explain)?;
    let texels = u64::from(size.0) * u64::from(size.1);
    if texels == 0 {
        return Err(fault("has no pixels; save it again".into()));
    }
    if size.0.max(size.1) > limits::TEXTURE_SIZE_MAX || texels * 4 + 16 > limits::BULK_MESSAGE_MAX as u64 {
        return Err(too_large(size));
    }
    let rgba = reader.decode().map_err(explain)?.into_rgba8();
    let (width, height) = rgba.dimensions();
    let texels = rgba.pixels().map(|pixel| pixel.0).collect();
    Ok(Texture { width, height, texels })
}
