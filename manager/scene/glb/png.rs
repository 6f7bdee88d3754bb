//! PNG files with stored data: larger than compressed ones, but made without a codec, so that their bytes are the same
//! with every version of every crate.

use super::{Channels, Picture};

/// A PNG file with stored data: PNG 1.2 around zlib (RFC 1950) around stored blocks (RFC 1951, 3.2.4).
pub(super) fn encode(picture: &Picture) -> Vec<u8> {
    let stride = picture.width as usize * picture.channels as usize;
    assert!(
        stride > 0 && picture.bytes.len() == stride * picture.height as usize,
        "a picture's bytes must fit its size"
    );
    let color_type = match picture.channels {
        Channels::Grey => 0,
        Channels::Rgb => 2,
        Channels::Rgba => 6,
    };
    let mut header = Vec::new();
    header.extend_from_slice(&picture.width.to_be_bytes());
    header.extend_from_slice(&picture.height.to_be_bytes());
    header.extend_from_slice(&[8, color_type, 0, 0, 0]);

    // Each row begins with its filter: none.
    let rows: Vec<u8> = picture.bytes.chunks(stride).flat_map(|row| [0].iter().chain(row)).copied().collect();
    let mut data = vec![0x78, 0x01];
    let mut blocks = rows.chunks(0xFFFF).peekable();
    while let Some(block) = blocks.next() {
        let length = u16::try_from(block.len()).expect("chunks are at most 0xFFFF long");
        data.push(u8::from(blocks.peek().is_none()));
        data.extend_from_slice(&length.to_le_bytes());
        data.extend_from_slice(&(!length).to_le_bytes());
        data.extend_from_slice(block);
    }
    let (mut a, mut b) = (1u32, 0u32); // Adler-32, RFC 1950, 8.2
    for &byte in &rows {
        a = (a + u32::from(byte)) % 65521;
        b = (b + a) % 65521;
    }
    data.extend_from_slice(&((b << 16) | a).to_be_bytes());

    let table = crc_table();
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, content) in [(b"IHDR", &header), (b"IDAT", &data), (b"IEND", &Vec::new())] {
        file.extend_from_slice(&u32::try_from(content.len()).expect("pictures are small").to_be_bytes());
        let start = file.len();
        file.extend_from_slice(kind);
        file.extend_from_slice(content);
        let crc = !file[start..]
            .iter()
            .fold(!0u32, |crc, &byte| table[((crc ^ u32::from(byte)) & 0xFF) as usize] ^ (crc >> 8));
        file.extend_from_slice(&crc.to_be_bytes());
    }
    file
}

/// The table of the CRC of PNG 1.2, appendix D.
fn crc_table() -> [u32; 256] {
    let mut table = [0; 256];
    for (row, n) in table.iter_mut().zip(0u32..) {
        *row = (0..8).fold(n, |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 });
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_standards() {
        let crc = |bytes: &[u8]| {
            let table = crc_table();
            !bytes.iter().fold(!0u32, |crc, &b| table[((crc ^ u32::from(b)) & 0xFF) as usize] ^ (crc >> 8))
        };
        assert_eq!(crc(b"123456789"), 0xCBF4_3926);
        let file = encode(&Picture { width: 1, height: 1, channels: Channels::Grey, bytes: vec![7] });
        assert_eq!(&file[file.len() - 4..], &0xAE42_6082u32.to_be_bytes(), "IEND always has this checksum");
    }

    #[cfg(feature = "import")]
    #[test]
    fn a_picture_comes_back_from_its_png() {
        for channels in [Channels::Grey, Channels::Rgb, Channels::Rgba] {
            let (width, height) = (300, 91);
            let count = width as usize * height as usize * channels as usize;
            let bytes: Vec<u8> = (0..count).map(|i| (i * 31 % 251) as u8).collect();
            let file = encode(&Picture { width, height, channels, bytes: bytes.clone() });
            let read = image::load_from_memory(&file).unwrap();
            assert_eq!((read.width(), read.height(), read.as_bytes()), (width, height, &bytes[..]));
        }
    }
}
