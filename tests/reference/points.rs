//! Where a pixel is looked at, if the pipeline's own pattern isn't wanted.

/// `count` well-spread points of the unit square: the Hammersley net, moved so that no coordinate lies on a border.
pub fn spread(count: usize) -> Vec<[f64; 2]> {
    (0..count)
        .map(|i| {
            let reversed = f64::from((i as u32).reverse_bits()) / f64::from(u32::MAX) / (1.0 + f64::EPSILON);
            let half = 0.5 / count as f64;
            [(i as f64 + 0.5) / count as f64, (reversed + half).clamp(half, 1.0 - half)]
        })
        .collect()
}

/// A `side` × `side` grid of the unit square's cell centres, row by row.
pub fn grid(side: usize) -> impl Iterator<Item = [f64; 2]> {
    let step = 1.0 / side as f64;
    (0..side * side).map(move |i| [((i % side) as f64 + 0.5) * step, ((i / side) as f64 + 0.5) * step])
}

/// Points round the unit square at distances up to `margin`, no farther apart than half of it: what "within one sample
/// spacing" of a pixel is looked at with.
pub fn ring(margin: f64) -> Vec<[f64; 2]> {
    let step = margin / 2.0;
    let cells = (1.0 / step).ceil() as i32 + 4;
    let mut points = Vec::new();
    for row in 0..=cells {
        for column in 0..=cells {
            let border = |k: i32| k <= 1 || k >= cells - 1;
            if border(row) || border(column) {
                let place = |k: i32| -margin + (1.0 + 2.0 * margin) * f64::from(k) / f64::from(cells);
                points.push([place(column), place(row)]);
            }
        }
    }
    points
}
