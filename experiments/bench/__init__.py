"""What the filters, the tracker and the rest of the flow cost, as ratios measured in one run."""
