//! `cyclorama bench lists`: how long it takes to select, by the number of objects, and beside the paper's plain algorithm.
//!
//! [`field`] is the world, [`check`] holds every answer against the plainest test of each object before its time counts, [`run`] times, [`fit`] finds the
//! numbers of the cost model from pictures that are really drawn.

mod check;
mod field;
mod fit;
mod run;

use crate::cli::ListsArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use ::bench::Report;
use ::bench::lists::{Change, What, figures, table};
use field::{Field, Layout};
use manager::scene::bvh::Cut;
use manager::select::Dispatch;
use run::{Setup, frames, plain, walks};
use std::num::NonZeroUsize;

/// Of a tree's objects, those that are in view: one in so many.
const IN_VIEW_EACH: f64 = 100.0;

/// Runs the command.
pub(crate) fn lists(args: &ListsArgs) -> Result<(), CommandError> {
    if args.fit {
        return fit::fit(args);
    }
    let setup = Setup::new(args);
    let mut rows = Vec::new();
    for &count in &args.objects {
        note(&format!("{count} objects …"));
        let mut field = Field::new(count, Cut::Middle);
        for change in [Change::Eye, Change::Objects, Change::Nothing] {
            for &processors in &args.processors {
                rows.push(frames(&mut field, &setup, What::Frame, change, processors)?);
            }
        }
        let whole = Setup { least_elements: None, ..setup };
        rows.push(frames(&mut field, &whole, What::Frame, Change::Eye, NonZeroUsize::MIN)?);
        if count <= args.plain_objects {
            rows.push(plain(&mut field, &setup));
        }
    }
    if !args.no_tree {
        tree(args, &setup, &mut rows)?;
    }
    for (cut, name) in [(Cut::Middle, "balanced"), (Cut::Eighth, "lopsided")] {
        note(&format!("{} objects in a {name} tree …", args.walk_objects));
        let mut field = Field::new(args.walk_objects, cut);
        rows.extend(walks(&mut field, &setup, name, &Dispatch::ALL)?);
    }
    let figures = figures(&rows);
    let shown = table(&rows, &figures);
    let report = Report::new("lists", rows, figures);
    let text = serde_json::to_string(&report).map_err(|error| CommandError::said(error.to_string()))?;
    say(if args.json { &text } else { shown.trim_end() });
    Ok(())
}

/// A large tree with 1 % of it in view, and that 1 % alone.
fn tree(args: &ListsArgs, setup: &Setup, rows: &mut Vec<::bench::lists::Row>) -> Result<(), CommandError> {
    note(&format!("{} objects, 1 % in view …", args.tree_objects));
    let layout = Layout::new(args.tree_objects);
    // Half a disc, for the views span half a turn.
    let area = layout.area_each() * args.tree_objects as f64 / IN_VIEW_EACH;
    let visibility = (2.0 * area / std::f64::consts::PI).sqrt();
    let setup = Setup { least_elements: None, visibility, ..*setup };
    let mut all = Field::new(args.tree_objects, Cut::Middle);
    let views = field::views();
    let ends = [0, setup.frames].into_iter();
    let mut seen: Vec<u32> =
        ends.flat_map(|frame| check::visible(&all, &setup.sight(&all, frame, &views))).flatten().collect();
    seen.sort_unstable();
    seen.dedup();
    rows.push(frames(&mut all, &setup, What::Tree, Change::Eye, NonZeroUsize::MIN)?);
    drop(all);
    let mut alone = Field::of(layout, &seen, Cut::Middle);
    rows.push(frames(&mut alone, &setup, What::TreeAlone, Change::Eye, NonZeroUsize::MIN)?);
    Ok(())
}
