//! Which tile of which view is whose, under the wiring in effect: a debug picture that no board needs to draw, for shares follow from
//! the wiring alone.

use super::Room;
use super::state::mode_name;
use crate::backplane::desk::Silence;
use crate::backplane::live::Live;
use axum::extract::State;
use axum::response::Json;
use proto::frame::{TILE, tile_grid};
use proto::ids::BoardId;
use proto::share::shares;
use serde::Serialize;
use std::sync::Arc;

/// The tiles of a view, row by row.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Tiles {
    columns: u32,
    rows: u32,
    mode: &'static str,
    /// The id of the board that draws each.
    owners: Vec<u32>,
}

/// The answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Owners {
    /// Of the wiring, and of the views: both change rarely.
    epoch: u64,
    views_revision: u64,
    /// Side of a tile, pixels.
    tile: u32,
    /// How many boards own tiles.
    boards: usize,
    views: Vec<Tiles>,
}

impl Owners {
    fn of(live: &Live) -> Self {
        let weights = live.wiring.as_ref().map_or(&[][..], |wiring| &wiring.weights);
        let mut views: Vec<Tiles> = live
            .views
            .iter()
            .map(|setup| {
                let (columns, rows) = tile_grid(setup.view.width, setup.view.height);
                let owners = if weights.is_empty() { Vec::new() } else { vec![0; columns as usize * rows as usize] };
                Tiles { columns, rows, mode: mode_name(setup.mode), owners }
            })
            .collect();
        for id in 0..weights.len() as u32 {
            for share in shares(BoardId(id), weights, &live.views) {
                let view = share.view.0 as usize;
                let (Some(setup), Some(tiles)) = (live.views.get(view), views.get_mut(view)) else { continue };
                for tile in share.part.tiles(setup.view.width, setup.view.height) {
                    tiles.owners[tile.y as usize * tiles.columns as usize + tile.x as usize] = id;
                }
            }
        }
        let epoch = live.wiring.as_ref().map_or(0, |wiring| wiring.epoch.0);
        Self { epoch, views_revision: live.views_revision, tile: TILE, boards: weights.len(), views }
    }
}

/// `GET /api/v1/owners`.
pub(super) async fn owners(State(room): State<Arc<Room>>) -> Result<Json<Owners>, Silence> {
    Ok(Json(Owners::of(&*room.desk.live().await?)))
}
