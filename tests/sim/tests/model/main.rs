//! Every interleaving of a small rig, on the daemons' own cores.
//!
//! Longer: `CYCLORAMA_DEPTH=40 cargo test -p cyclorama-sim --test model -- --nocapture`.
#![expect(clippy::unwrap_used, reason = "a test that can't go on has failed")]
#![expect(clippy::print_stdout, reason = "how many states were looked at")]

mod first_term;
mod terms;
mod wiring;

use stateright::{Checker, HasDiscoveries, Model};
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

/// A planted bug is the whole process's.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The depth to look at, unless a longer run asks for another.
fn depth(usual: usize) -> usize {
    std::env::var("CYCLORAMA_DEPTH").ok().and_then(|depth| depth.parse().ok()).unwrap_or(usual)
}

/// Looks at every state up to a depth. Returns the names of violated "always" properties, and of "sometimes" ones not met.
fn look<M>(name: &str, model: M, depth: usize) -> Vec<&'static str>
where
    M: Model + Send + Sync + 'static,
    M::State: Clone + std::hash::Hash + Send + Sync + std::fmt::Debug + PartialEq,
    M::Action: Clone + std::fmt::Debug + PartialEq + Send + Sync,
{
    let began = Instant::now();
    let checker = model.checker().threads(2).target_max_depth(depth).finish_when(HasDiscoveries::AnyFailures);
    let checker = checker.spawn_bfs().join();
    println!(
        "{name}: {} states, {} of them different, depth {}, {:.1} s",
        checker.state_count(),
        checker.unique_state_count(),
        checker.max_depth(),
        began.elapsed().as_secs_f64()
    );
    let found = checker.discoveries();
    let mut wrong = Vec::new();
    for property in checker.model().properties() {
        match (property.expectation, found.get(property.name)) {
            (stateright::Expectation::Sometimes, None) => wrong.push(property.name),
            (stateright::Expectation::Always | stateright::Expectation::Eventually, Some(path)) => {
                println!("{}: {:?}", property.name, path.clone().into_actions());
                wrong.push(property.name);
            }
            _ => {}
        }
    }
    wrong
}
