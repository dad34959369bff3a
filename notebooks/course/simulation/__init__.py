"""Problems with a known answer: random five-point problems, simulated matches, truth of drawn scenes."""
