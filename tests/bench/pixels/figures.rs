//! proof.md's figures of pixels, from rows.
//!
//! A figure is of all the scenes that it names, at the size that its target is for, or it has no value and says what is
//! missing: a worst case over half of the scenes would be a claim about the other half.

use super::{Renderer, Row, Sampling};
use crate::Figure;

/// The scenes that figures are of, see `manager/scene/builtin/bench`.
pub const SCENES: [&str; 5] = ["city", "dense", "smoke", "runway", "overdraw"];

/// What the targets are for: pixels.
const SIZE: [u32; 2] = [1920, 1080];
/// … and threads.
const THREADS: usize = 2;

/// What decides how rows are read.
#[derive(Clone, Debug, Default)]
pub struct Setting {
    /// Threads of the rows that figures are of, where the figure doesn't say otherwise.
    pub threads: usize,
    /// Why there is no peer, if there is none.
    pub no_peer: Option<String>,
    /// Why there is no reference, if there is none.
    pub no_reference: Option<String>,
}

/// At most or at least a number.
#[derive(Clone, Copy)]
enum Limit {
    Most(f64),
    Least(f64),
}

/// The name, unit and target of a figure.
type Definition = (&'static str, &'static str, &'static str, Limit);

/// All figures, each with a value or the reason why it has none.
pub fn figures(rows: &[Row], setting: &Setting) -> Vec<Figure> {
    use Limit::{Least, Most};
    let look = Look { rows, setting };
    let one = Sampling::Points(1);
    let many = Sampling::Points(64);
    let ratio = |scene: &str, ours, theirs| Ok(look.ours(scene, ours)?.ms.median / look.peer(scene, theirs)?.ms.median);
    let without_overdraw = || SCENES.into_iter().filter(|scene| *scene != "overdraw");
    let list: [(Definition, Result<f64, String>); 12] = [
        (
            ("pixels.ratio_1_geomean", "", "<= 1/5", Most(0.2)),
            without_overdraw()
                .map(|scene| ratio(scene, one, 0))
                .collect::<Result<Vec<f64>, _>>()
                .map(|all| geomean(&all)),
        ),
        (("pixels.ratio_1_worst", "", "<= 1/4", Most(0.25)), worst(SCENES, |scene| ratio(scene, one, 0))),
        (("pixels.ratio_64_vs_0", "", "<= 1", Most(1.0)), worst(SCENES, |scene| ratio(scene, many, 0))),
        (("pixels.ratio_64_vs_4", "", "<= 1/4", Most(0.25)), worst(SCENES, |scene| ratio(scene, many, 4))),
        (
            ("pixels.edge_error_ratio_64", "", "<= 1/6", Most(1.0 / 6.0)),
            worst(SCENES, |scene| {
                let ours = look.error(look.ours(scene, many)?, |row| row.rms_edges)?;
                Ok(ours / look.error(look.peer(scene, 4)?, |row| row.rms_edges)?)
            }),
        ),
        (
            // The largest error and not the mean: `exact` claims to be the integral in every pixel.
            ("pixels.exact_error", "full scale", "<= 1e-4", Most(1e-4)),
            worst(SCENES, |scene| look.error(look.ours(scene, Sampling::Exact)?, |row| row.max_all)),
        ),
        (
            ("pixels.exact_time_ratio", "", "<= 4", Most(4.0)),
            worst(SCENES, |scene| Ok(look.ours(scene, Sampling::Exact)?.ms.median / look.ours(scene, many)?.ms.median)),
        ),
        (
            ("pixels.fill_ratio", "", "<= 6", Most(6.0)),
            look.ours("runway", one).and_then(|ours| Ok(ours.ms.median / look.memory("runway")?.ms.median)),
        ),
        (("pixels.dense_ms", "ms", "<= 20", Most(20.0)), look.ours("dense", one).map(|row| row.ms.median)),
        (
            ("pixels.dense_scaling", "", ">= 1.7", Least(1.7)),
            look.ours("dense", one).and_then(|two| Ok(look.on_one_thread("dense", one)?.ms.median / two.ms.median)),
        ),
        (
            ("pixels.overdraw_ratio", "", "<= 1.5", Most(1.5)),
            look.ours("overdraw", one).and_then(|all| Ok(all.ms.median / look.ours("overdraw-front", one)?.ms.median)),
        ),
        (("pixels.smoke_ratio", "", "<= 1/4", Most(0.25)), ratio("smoke", one, 0)),
    ];
    list.into_iter().map(|(definition, value)| figure(definition, value)).collect()
}

fn figure((name, unit, target, limit): Definition, value: Result<f64, String>) -> Figure {
    let met = |value: f64| match limit {
        Limit::Most(limit) => value <= limit,
        Limit::Least(limit) => value >= limit,
    };
    let (value, why) = match value {
        Ok(value) => (Some(value), None),
        Err(why) => (None, Some(why)),
    };
    Figure { figure: name, value, unit, target, met: value.map(met), why }
}

fn geomean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len() as f64).exp()
}

fn worst(scenes: [&str; 5], value: impl Fn(&str) -> Result<f64, String>) -> Result<f64, String> {
    scenes.iter().try_fold(0.0, |worst: f64, scene| Ok(worst.max(value(scene)?)))
}

/// Finds rows.
struct Look<'a> {
    rows: &'a [Row],
    setting: &'a Setting,
}

impl<'a> Look<'a> {
    fn row(
        &self,
        scene: &str,
        renderer: Renderer,
        samples: Option<Sampling>,
        threads: usize,
    ) -> Result<&'a Row, String> {
        let is_it = |row: &&Row| {
            row.scene == scene
                && row.renderer == renderer
                && row.samples == samples
                && row.threads == threads
                && row.variant.is_none()
        };
        let Some(row) = self.rows.iter().find(is_it) else {
            let how = match samples {
                Some(Sampling::Points(n)) => format!(" with {n} samples"),
                Some(Sampling::Exact) => " exactly".into(),
                None => String::new(),
            };
            return Err(format!("{scene} was not measured{how} by {renderer} on {threads} threads"));
        };
        match row.size {
            SIZE => Ok(row),
            [w, h] => Err(format!("the target is for {}x{}, and {scene} was drawn at {w}x{h}", SIZE[0], SIZE[1])),
        }
    }

    fn ours(&self, scene: &str, samples: Sampling) -> Result<&'a Row, String> {
        self.row(scene, Renderer::Cyclorama, Some(samples), self.setting.threads)
    }

    fn on_one_thread(&self, scene: &str, samples: Sampling) -> Result<&'a Row, String> {
        match self.setting.threads {
            THREADS => self.row(scene, Renderer::Cyclorama, Some(samples), 1),
            other => Err(format!("the target is for one thread against {THREADS}, not {other}")),
        }
    }

    fn peer(&self, scene: &str, samples: usize) -> Result<&'a Row, String> {
        match &self.setting.no_peer {
            Some(why) => Err(why.clone()),
            None => self.row(scene, Renderer::Llvmpipe, Some(Sampling::Points(samples)), self.setting.threads),
        }
    }

    fn memory(&self, scene: &str) -> Result<&'a Row, String> {
        self.row(scene, Renderer::Memory, None, self.setting.threads)
    }

    fn error(&self, row: &Row, which: impl Fn(&Row) -> Option<f64>) -> Result<f64, String> {
        which(row).ok_or_else(|| match &self.setting.no_reference {
            Some(why) => why.clone(),
            None => format!("{} was not compared with the reference", row.scene),
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn row(scene: &str, renderer: Renderer, samples: Option<Sampling>, threads: usize, ms: f64) -> Row {
        let times = [ms / 2.0, ms, ms * 2.0];
        Row { size: SIZE, threads, ..Row::timed(scene, renderer, samples, &times) }
    }

    /// Rows of a run in which every figure can be told.
    pub(crate) fn rows() -> Vec<Row> {
        let mut rows = Vec::new();
        for (k, scene) in SCENES.into_iter().enumerate() {
            let k = k as f64;
            for (samples, ms, rms) in [
                (Sampling::Points(1), 2.0 + k, 0.08),
                (Sampling::Points(64), 8.0, 0.002 + k / 1000.0),
                (Sampling::Exact, 20.0, 1e-6),
            ] {
                let mut row = row(scene, Renderer::Cyclorama, Some(samples), 2, ms);
                (row.rms_edges, row.rms_all, row.max_all) = (Some(rms), Some(rms / 2.0), Some(rms * 10.0));
                rows.push(row);
            }
            for (samples, ms, rms) in [(0, 20.0, 0.08), (4, 80.0, 0.06)] {
                let mut row = row(scene, Renderer::Llvmpipe, Some(Sampling::Points(samples)), 2, ms);
                row.rms_edges = Some(rms);
                rows.push(row);
            }
            rows.push(row(scene, Renderer::Memory, None, 2, 0.5));
        }
        rows.push(row("dense", Renderer::Cyclorama, Some(Sampling::Points(1)), 1, 4.5));
        rows.push(row("overdraw-front", Renderer::Cyclorama, Some(Sampling::Points(1)), 2, 5.0));
        let mut ablated = row("city", Renderer::Cyclorama, Some(Sampling::Points(1)), 2, 1000.0);
        ablated.variant = Some("without something".into());
        rows.insert(0, ablated);
        rows
    }

    fn find(all: &[Figure], name: &str) -> Figure {
        all.iter().find(|figure| figure.figure == name).cloned().unwrap()
    }

    #[test]
    fn figures_are_what_their_definitions_say() {
        let setting = Setting { threads: 2, ..Setting::default() };
        let all = figures(&rows(), &setting);
        assert_eq!(all.len(), 12);
        for (name, value, met) in [
            // The scenes take 2, 3, 4 and 5 ms where the peer takes 20.
            ("pixels.ratio_1_geomean", (120.0f64).powf(0.25) / 20.0, true),
            ("pixels.ratio_1_worst", 6.0 / 20.0, false),
            ("pixels.ratio_64_vs_0", 8.0 / 20.0, true),
            ("pixels.ratio_64_vs_4", 8.0 / 80.0, true),
            ("pixels.edge_error_ratio_64", 0.006 / 0.06, true),
            ("pixels.exact_error", 1e-5, true),
            ("pixels.exact_time_ratio", 20.0 / 8.0, true),
            ("pixels.fill_ratio", 5.0 / 0.5, false),
            ("pixels.dense_ms", 3.0, true),
            ("pixels.dense_scaling", 1.5, false),
            ("pixels.overdraw_ratio", 6.0 / 5.0, true),
            ("pixels.smoke_ratio", 4.0 / 20.0, true),
        ] {
            let figure = find(&all, name);
            let got = figure.value.unwrap_or_else(|| panic!("{figure:?}"));
            assert!((got - value).abs() < 1e-12, "{name}: {got}, not {value}");
            assert_eq!(figure.met, Some(met), "{name}");
        }
    }

    #[test]
    fn what_was_not_measured_has_no_value_and_says_why() {
        let no_peer = Some("libEGL can't be opened".to_owned());
        let setting = Setting { threads: 2, no_peer, no_reference: Some("run with --reference".into()) };
        let mut some: Vec<Row> = rows().into_iter().filter(|row| row.scene != "smoke").collect();
        some.iter_mut().for_each(|row| row.max_all = None);
        let all = figures(&some, &setting);
        for (name, said) in [
            ("pixels.ratio_64_vs_4", "libEGL can't be opened"),
            ("pixels.exact_time_ratio", "smoke was not measured exactly by cyclorama on 2 threads"),
            ("pixels.exact_error", "run with --reference"),
        ] {
            let figure = find(&all, name);
            assert_eq!((figure.value, figure.met), (None, None), "{name}");
            assert_eq!(figure.why.as_deref(), Some(said), "{name}");
        }
        assert_eq!(find(&all, "pixels.dense_ms").met, Some(true), "needs neither");
    }

    #[test]
    fn other_sizes_and_thread_counts_have_other_figures() {
        let mut small = rows();
        small.iter_mut().for_each(|row| row.size = [640, 360]);
        let all = figures(&small, &Setting { threads: 2, ..Setting::default() });
        assert!(all.iter().all(|figure| figure.value.is_none()));
        assert!(find(&all, "pixels.dense_ms").why.unwrap().contains("640x360"));
        let all = figures(&rows(), &Setting { threads: 4, ..Setting::default() });
        assert!(find(&all, "pixels.dense_scaling").why.unwrap().contains("4"));
    }
}
