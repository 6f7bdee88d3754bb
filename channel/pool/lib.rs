//! Threads that work on what their caller has borrowed, without an allocation.
//!
//! A renderer's threads live as long as it does, what they draw lives for one frame. `std::thread::scope` lends to threads, but starts
//! them anew; rayon's pool lends to threads that wait, but its way in from outside is a queue on the heap that takes a new block at
//! every 63rd call. Here a call hands every thread the same reference and returns when all of them have done with it.
//!
//! Each thread begins with a stretch of its own, so that neighbouring items, which tend to read the same, are one thread's; who is
//! through with it takes what is left of the others'. Taking an item is one atomic addition; the only lock is at a call's beginning
//! and end.
#![expect(
    unsafe_code,
    reason = "the lifetime of what is lent, items that are each given to one thread, and the system's scheduler"
)]

pub mod turns;

use std::any::Any;
use std::io;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

/// What a thread does in a round, by its number.
type Work<'a> = dyn Fn(usize) + Sync + 'a;

/// A number on a cache line of its own (two, where they are fetched in pairs).
#[derive(Debug, Default)]
#[repr(align(128))]
struct Alone(AtomicUsize);

/// Where the threads are.
#[derive(Default)]
struct State {
    /// Counts the calls.
    round: u64,
    /// What is done in this round; `None` between rounds.
    work: Option<&'static Work<'static>>,
    /// Threads below this number take part.
    wanted: usize,
    /// Of these, those that haven't done yet.
    busy: usize,
    /// The first panic of this round.
    panic: Option<Box<dyn Any + Send>>,
    ends: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    /// A round has begun, or all ends.
    begun: Condvar,
    /// A round is done.
    done: Condvar,
}

impl Shared {
    /// Nothing panics while it holds the lock.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A thread's life.
    fn serve(&self, thread: usize) {
        let mut seen = 0;
        loop {
            let work = {
                let mut state = self.state();
                loop {
                    if state.ends {
                        return;
                    }
                    if state.round != seen {
                        seen = state.round;
                        if let Some(work) = state.work.filter(|_| thread < state.wanted) {
                            break work;
                        }
                    }
                    state = self.begun.wait(state).unwrap_or_else(PoisonError::into_inner);
                }
            };
            let panic = catch_unwind(AssertUnwindSafe(|| work(thread))).err();
            let mut state = self.state();
            state.panic = state.panic.take().or(panic);
            state.busy -= 1;
            if state.busy == 0 {
                state.work = None;
                drop(state);
                self.done.notify_one();
            }
        }
    }
}

/// Threads that wait for work. They end with it.
pub struct Pool {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    /// By thread: the next item of its stretch.
    next: Vec<Alone>,
}

impl Pool {
    /// Starts threads called `name`-0, `name`-1 and so on, each of which does `first` with its number before anything else. A panic of
    /// `first` ends only that.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new(threads: NonZeroUsize, name: &str, first: impl Fn(usize) + Send + Sync + 'static) -> io::Result<Self> {
        let first = Arc::new(first);
        let mut pool = Self { shared: Arc::default(), threads: Vec::new(), next: Vec::new() };
        for thread in 0..threads.get() {
            let (shared, first) = (Arc::clone(&pool.shared), Arc::clone(&first));
            let serve = move || {
                // A thread that were missing would be waited for in vain. The panic has been printed.
                let _ = catch_unwind(AssertUnwindSafe(|| first(thread)));
                drop(first);
                shared.serve(thread);
            };
            pool.threads.push(Builder::new().name(format!("{name}-{thread}")).spawn(serve)?);
            pool.next.push(Alone::default());
        }
        Ok(pool)
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.threads.len()
    }

    /// Does `work` once with each of `items`, and each thread with its own of `states`. Which thread does what, and in which order,
    /// is not said. Returns when all is done.
    ///
    /// # Panics
    /// If there are fewer states than threads. A panic of `work` is passed on when all threads have done; items that its thread
    /// would have taken may be left out.
    pub fn for_each<S: Send, T: Send>(
        &mut self,
        states: &mut [S],
        items: &mut [T],
        work: impl Fn(&mut S, &mut T) + Sync,
    ) {
        let (threads, count) = (self.threads().min(items.len()), items.len());
        self.each(states, items, work, |thread| thread * count / threads);
    }

    /// The same, but items are taken in their order: whichever thread is free takes the next.
    ///
    /// # Panics
    /// As [`Pool::for_each`].
    pub fn for_each_in_turn<S: Send, T: Send>(
        &mut self,
        states: &mut [S],
        items: &mut [T],
        work: impl Fn(&mut S, &mut T) + Sync,
    ) {
        let count = items.len();
        self.each(states, items, work, |thread| if thread == 0 { 0 } else { count });
    }

    /// `first_of` tells where a thread's stretch begins; it ends where the next one's does. Ascending from 0, and the number of items for one
    /// more than the last thread.
    fn each<S: Send, T: Send>(
        &mut self,
        states: &mut [S],
        items: &mut [T],
        work: impl Fn(&mut S, &mut T) + Sync,
        first_of: impl Fn(usize) -> usize + Sync,
    ) {
        let wanted = self.threads().min(items.len());
        if wanted == 0 {
            return;
        }
        assert!(states.len() >= wanted, "each thread has a state");
        for (thread, next) in self.next[..wanted].iter().enumerate() {
            next.0.store(first_of(thread), Ordering::Relaxed);
        }
        let next = &self.next[..wanted];
        let (ends, states, items) = (|thread: usize| first_of(thread + 1), Parts::of(states), Parts::of(items));
        let round = |thread: usize| {
            // SAFETY: the threads of a round have different numbers, and each is in it once.
            let state = unsafe { states.part(thread) };
            for owner in (thread..wanted).chain(0..thread) {
                loop {
                    let item = next[owner].0.fetch_add(1, Ordering::Relaxed);
                    if item >= ends(owner) {
                        break;
                    }
                    // SAFETY: the stretches don't overlap, and an addition gives each number of a stretch to one thread only.
                    work(state, unsafe { items.part(item) });
                }
            }
        };
        Self::lend(&self.shared, wanted, &round);
    }

    /// Lets the first `wanted` threads do `work`, each once. That the caller has the pool to itself makes it the only round.
    fn lend(shared: &Shared, wanted: usize, work: &Work<'_>) {
        // SAFETY: only the lifetime is changed. The reference goes to the threads of this round and to no one else; each counts itself out
        // after its last use of it, the last one takes it out of the state, and below we wait for that. Nothing between here and
        // there can panic.
        let work = unsafe { std::mem::transmute::<&Work<'_>, &'static Work<'static>>(work) };
        let mut state = shared.state();
        state.work = Some(work);
        (state.wanted, state.busy) = (wanted, wanted);
        state.round += 1;
        shared.begun.notify_all();
        while state.busy > 0 {
            state = shared.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let panic = state.panic.take();
        drop(state);
        if let Some(panic) = panic {
            resume_unwind(panic);
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.state().ends = true;
        self.shared.begun.notify_all();
        for thread in self.threads.drain(..) {
            // Its panics were passed on when they happened.
            let _ = thread.join();
        }
    }
}

impl std::fmt::Debug for Pool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pool").field("threads", &self.threads()).finish_non_exhaustive()
    }
}

/// A slice of which several threads have different elements.
struct Parts<'a, T> {
    first: *mut T,
    count: usize,
    slice: std::marker::PhantomData<&'a mut [T]>,
}

// SAFETY: all that can be done with it in another thread is to take an element, as if it had been sent there.
unsafe impl<T: Send> Sync for Parts<'_, T> {}

impl<'a, T> Parts<'a, T> {
    fn of(slice: &'a mut [T]) -> Self {
        Self { first: slice.as_mut_ptr(), count: slice.len(), slice: std::marker::PhantomData }
    }

    /// An element.
    ///
    /// # Safety
    /// No element is taken twice.
    unsafe fn part(&self, index: usize) -> &'a mut T {
        assert!(index < self.count, "an element of the slice");
        // SAFETY: it is within the slice that is borrowed for 'a, and the caller promises that it is borrowed from here only once.
        unsafe { &mut *self.first.add(index) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pool(threads: usize) -> Pool {
        Pool::new(NonZeroUsize::new(threads).unwrap(), "test", |_| ()).unwrap()
    }

    #[test]
    fn each_item_is_done_once_by_any_number_of_threads() {
        for threads in [1, 2, 3, 7] {
            let mut pool = pool(threads);
            let mut done = vec![0usize; threads];
            for count in [0, 1, 2, 3, 6, 7, 8, 100, 1000] {
                done.fill(0);
                let mut items: Vec<usize> = (0..count).collect();
                pool.for_each(&mut done, &mut items, |done, item| {
                    *done += 1;
                    *item += 1;
                });
                assert_eq!(done.iter().sum::<usize>(), count, "{threads} threads");
                assert!(items.into_iter().eq(1..=count), "{threads} threads, {count} items");
            }
        }
    }

    #[test]
    fn items_in_turn_are_begun_in_their_order() {
        for threads in [1, 2, 3, 7] {
            let mut pool = pool(threads);
            let begun = AtomicUsize::new(0);
            let mut ranks = vec![usize::MAX; 200];
            let mut own: Vec<Vec<usize>> = vec![Vec::new(); threads];
            let mut items: Vec<(usize, &mut usize)> = ranks.iter_mut().enumerate().collect();
            pool.for_each_in_turn(&mut own, &mut items, |own, (item, rank)| {
                own.push(*item);
                **rank = begun.fetch_add(1, Ordering::Relaxed);
            });
            drop(items);
            assert!(own.iter().all(|own| own.is_sorted()), "{threads} threads");
            assert_eq!(own.iter().map(Vec::len).sum::<usize>(), 200, "{threads} threads");
            // Between threads only that each takes the next is sure, not who then is quicker.
            assert!(threads > 1 || ranks.is_sorted());
            let mut sorted = ranks;
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..200), "each once");
        }
    }

    #[test]
    fn many_short_rounds_follow_one_another() {
        let mut pool = pool(3);
        let mut sums = [0u64; 3];
        for round in 0..20_000u64 {
            let mut items = [round; 4];
            pool.for_each(&mut sums, &mut items[..(round % 5) as usize], |sum, item| *sum += *item);
        }
        let expected: u64 = (0..20_000).map(|round| round * (round % 5)).sum();
        assert_eq!(sums.iter().sum::<u64>(), expected);
    }

    /// The first thread gets stuck in its first item until all others are done, which no thread that keeps to its own could do.
    #[test]
    fn who_is_through_helps_the_others() {
        let mut pool = pool(2);
        let done = AtomicUsize::new(0);
        let mut items: Vec<usize> = (0..10).collect();
        pool.for_each(&mut [(), ()], &mut items, |(), item| {
            while *item == 0 && done.load(Ordering::Relaxed) < 9 {
                std::thread::yield_now();
            }
            done.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(done.into_inner(), 10);
    }

    #[test]
    fn a_panic_comes_out_and_the_pool_goes_on() {
        let mut pool = pool(2);
        let mut states = [0, 0];
        let panic = catch_unwind(AssertUnwindSafe(|| {
            pool.for_each(&mut states, &mut [1, 2, 3, 4], |_, item| assert_ne!(*item, 3, "the third"));
        }));
        let message = panic.unwrap_err();
        assert!(message.downcast_ref::<String>().is_some_and(|text| text.contains("the third")));
        pool.for_each(&mut states, &mut [1, 2, 3, 4], |state, item| *state += *item);
        assert_eq!(states.iter().sum::<i32>(), 10);
    }

    #[test]
    fn each_thread_begins_with_its_number() {
        let begun: &'static Mutex<Vec<usize>> = Box::leak(Box::default());
        let pool =
            Pool::new(NonZeroUsize::new(4).unwrap(), "test", |thread| begun.lock().unwrap().push(thread)).unwrap();
        assert_eq!(pool.threads(), 4);
        drop(pool);
        let mut begun = begun.lock().unwrap();
        begun.sort_unstable();
        assert_eq!(*begun, [0, 1, 2, 3]);
    }
}
