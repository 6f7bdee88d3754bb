//! Which shortcut a block or a pixel took: the questions that [`crate::resolve::tile`] asks, asked again.

use super::{Place, each_pixel};
use crate::raster::coverage::{BLOCK, BLOCK_PIXELS, BLOCKS};
use crate::raster::visible::{NOTHING, Visible};
use crate::resolve::tile::{Resolved, TileOutput};
use crate::shade::tile::{Look, TileFaces};
use proto::debug::{HIDDEN, Way, hidden_side, way_color};

/// The way of a block that is decided as a whole.
fn of_block(tile: Resolved<'_>, faces: &mut TileFaces, block: usize) -> Option<Way> {
    let Resolved { frame, rect, numbers, visible, layers } = tile;
    let cells = visible.block(block);
    if !layers.block(block).is_empty() || cells.iter().any(|cell| *cell != cells[0]) {
        return None;
    }
    if cells[0] == NOTHING {
        return Some(Way::Background);
    }
    let place = Visible::single(cells[0])?;
    match faces.look(frame, rect, place, numbers[place as usize]) {
        Look::Constant(..) => Some(Way::Constant),
        Look::ByNormal(_) => Some(Way::ByNormal),
        Look::General => None,
    }
}

fn of_pixel(tile: Resolved<'_>, block: usize, bit: usize) -> Way {
    let is_touched = tile.layers.block(block).iter().any(|layer| layer.touched >> bit & 1 != 0);
    let cell = tile.visible.block(block)[bit];
    match () {
        () if is_touched => Way::Layers,
        () if cell == NOTHING || Visible::single(cell).is_some() => Way::Single,
        () => Way::Several,
    }
}

/// Paints a tile; `hidden` is how many faces are behind what is seen, block by block.
pub(super) fn paint(tile: Resolved<'_>, faces: &mut TileFaces, hidden: &[u32; BLOCKS], out: &mut TileOutput<'_>) {
    let mut last = (usize::MAX, None);
    each_pixel(tile, |pixel, to: Place| {
        let (block, bit) = (pixel / BLOCK_PIXELS, pixel % BLOCK_PIXELS);
        if last.0 != block {
            last = (block, of_block(tile, faces, block));
        }
        let side = hidden_side(hidden[block]);
        let is_marked = to.x % BLOCK < side && to.y % BLOCK < side;
        to.put(out, if is_marked { HIDDEN } else { way_color(last.1.unwrap_or_else(|| of_pixel(tile, block, bit))) });
    });
}
