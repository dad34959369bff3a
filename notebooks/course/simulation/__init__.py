"""Problems with a known answer: five-point problems, simulated matches, a lorry, truth of drawn scenes."""
