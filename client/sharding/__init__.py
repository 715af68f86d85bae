"""One evaluation as shards that run anywhere, and the shards as one evaluation again."""
