"""Problems with a known answer: five-point problems, simulated drives, a lorry, truth of drawn scenes."""
