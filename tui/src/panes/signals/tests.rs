//! Values at the cursors.

use super::*;

fn bucket(t: i64, min: f64, max: f64, last: f64) -> Bucket {
    Bucket { t, min, max, last }
}

#[test]
fn what_holds_at_a_cursor_is_put_where_a_bucket_cannot_tell() {
    let coarse = Arc::new(vec![bucket(0, 1.0, 3.0, 3.0), bucket(100, 4.0, 4.0, 4.0)]);
    let mut points = Arc::clone(&coarse);
    // Within the first bucket 2 held at 50; of the second its only value is known.
    put(&mut points, 50, 2.0);
    put(&mut points, 150, 4.0);
    put(&mut points, -1, 7.0);
    assert_eq!(*points, [bucket(0, 1.0, 3.0, 3.0), bucket(50, 2.0, 2.0, 2.0), bucket(100, 4.0, 4.0, 4.0)]);
    // What others have is left alone.
    assert_eq!(coarse.len(), 2);
}
