//! Room: the memory that buffers keep from frame to frame.
//!
//! A frame allocates only where a buffer has to grow beyond what it ever was. Buffers of the frame come to that within one frame. Those of a
//! tile belong to the thread that draws it, and which thread that is differs from frame to frame: one may meet the fullest tile
//! long after the others did. So after a frame each thread's buffers are made as large as the largest thread's are ([`Room`]); what any thread
//! has drawn all can then draw. Capacities are compared, nothing is copied.

/// Buffers of one thread, which others have too.
pub(crate) trait Room {
    /// Gives its buffers at least the room that those of `other` have.
    fn make_room(&mut self, other: &Self);
}

impl<T> Room for Vec<T> {
    fn make_room(&mut self, other: &Self) {
        if self.capacity() < other.capacity() {
            self.reserve_exact(other.capacity() - self.len());
        }
    }
}

/// A buffer that is made when first needed.
impl<T: Copy> Room for Option<Box<T>> {
    fn make_room(&mut self, other: &Self) {
        if self.is_none() {
            self.clone_from(other);
        }
    }
}

impl<T: Room, const N: usize> Room for [T; N] {
    fn make_room(&mut self, other: &Self) {
        for (own, other) in self.iter_mut().zip(other) {
            own.make_room(other);
        }
    }
}

/// Implements [`Room`] by that of the fields before the semicolon; those after it need none. All fields are named, so that a new one
/// can't be forgotten.
macro_rules! room {
    ($type:ident: $($field:ident),*; $($none:ident),*) => {
        impl $crate::room::Room for $type {
            fn make_room(&mut self, other: &Self) {
                let Self { $($field,)* $($none: _,)* } = other;
                $($crate::room::Room::make_room(&mut self.$field, $field);)*
            }
        }
    };
}
pub(crate) use room;

/// Makes the room of all threads' buffers that of the largest.
pub(crate) fn share_room<T: Room>(threads: &mut [T]) {
    let Some((first, others)) = threads.split_first_mut() else { return };
    for other in &mut *others {
        first.make_room(other);
    }
    for other in others {
        other.make_room(first);
    }
}

/// The same vector without its elements, for others that borrow from something else: buffers are kept longer than what is lent to a
/// frame. The standard library collects in place what has the same size, so the room stays.
pub(crate) fn emptied<T, U>(mut elements: Vec<T>) -> Vec<U> {
    const { assert!(size_of::<T>() == size_of::<U>() && align_of::<T>() == align_of::<U>(), "but for lifetimes one type") };
    elements.clear();
    elements.into_iter().map(|_| unreachable!("cleared")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_get_the_largest_room_of_each_buffer() {
        struct Buffers {
            a: Vec<u8>,
            b: [Vec<u64>; 2],
            count: usize,
        }
        room!(Buffers: a, b; count);
        let of =
            |a, b, c| Buffers { a: Vec::with_capacity(a), b: [Vec::with_capacity(b), Vec::with_capacity(c)], count: 0 };
        let mut threads = [of(100, 0, 3), of(0, 50, 7), of(20, 20, 20)];
        threads[1].a.extend([1, 2, 3]);
        share_room(&mut threads);
        for thread in &threads {
            assert!(thread.a.capacity() >= 100 && thread.b[0].capacity() >= 50 && thread.b[1].capacity() >= 20);
            assert_eq!(thread.count, 0);
        }
        assert_eq!(threads[1].a, [1, 2, 3]);
    }

    #[test]
    fn an_emptied_vector_keeps_its_room() {
        let text = String::from("a frame's");
        let mut borrowing: Vec<&str> = emptied(Vec::<&'static str>::with_capacity(40));
        borrowing.push(&text);
        let place = borrowing.as_ptr() as usize;
        let kept: Vec<&'static str> = emptied(borrowing);
        assert!(kept.is_empty());
        assert_eq!((kept.capacity(), kept.as_ptr() as usize), (40, place));
    }
}
